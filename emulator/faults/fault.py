"""What every fault is, and what of a device it may touch."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Annotated, ClassVar, Protocol, get_args, get_origin, get_type_hints

from ..boards.package import Package
from ..control.chain import Chain, Tamper
from ..control.controller import Controller
from ..firmware.flash import Flash
from ..interfaces.usb_device import UsbDevice
from ..scheduler import Scheduler
from .limits import Limits, Period, Periods

__all__ = ["FaultTarget", "InjectedFault", "Lasting", "limits"]


class FaultTarget(Protocol):
    """The device as a fault sees it; `Emulator` is one."""

    scheduler: Scheduler
    flash: Flash
    usb: UsbDevice
    chain: Chain
    """Only while the boards have power."""
    tampers: list[Tamper]
    """What damages the messages of the chain."""
    open_since: dict[int, int]
    """Transducers that are not connected, each with the core cycle since when."""

    @property
    def processors(self) -> Sequence[Package]:
        """The processors in the order of the chain; none if the boards have no power."""

    @property
    def running(self) -> Controller:
        """The controller; raises `ValueError` while the device starts."""

    def log(self, where: str, what: str) -> None:
        """Enter something that happens now into the device's events."""

    def inject(self, *faults: InjectedFault) -> None:
        """Let things go wrong, now or at the periods that they name."""

    def unfold(self) -> None:
        """From now on let every message travel along the chain token by token."""

    def power_up(self) -> None:
        """Get power back."""

    def power_down(self) -> None:
        """Lose power at once."""


def limits(kind: type[InjectedFault]) -> dict[str, tuple[Limits, bool]]:
    """What each field of a fault may be, and whether it may be None."""
    found: dict[str, tuple[Limits, bool]] = {}
    for name, hint in get_type_hints(kind, include_extras=True).items():
        choices = get_args(hint)
        if type(None) in choices:
            found[name] = choices[0].__metadata__[0], True
        elif get_origin(hint) is Annotated:
            found[name] = hint.__metadata__[0], False
    return found


@dataclass(frozen=True, kw_only=True)
class InjectedFault:
    """Something that goes wrong.

    Parameters
    ----------
    period : int, optional
        The device's period, counted from its last period 0; at once by default. A restart in between does not delay it.

    Raises
    ------
    ValueError
        If a field is not what it may be.
    """

    period: Period | None = None

    on_boards: ClassVar[bool] = False
    """Whether it concerns boards or the chain, which are as new after each start: it is brought about again then."""
    unfolds: ClassVar[bool] = True
    """Whether messages must travel along the chain token by token, for it to matter."""

    def __post_init__(self) -> None:
        """Check the fields."""
        for name, (allowed, optional) in limits(type(self)).items():
            value = getattr(self, name)
            if value not in allowed and not (optional and value is None):
                raise ValueError(f"{self.name()}: {name} = {value!r}; it must be {allowed}")

    @classmethod
    def name(cls) -> str:
        """What it is called in files and logs."""
        return re.sub(r"(?<!^)(?=[A-Z])", "-", cls.__name__).lower()

    def __str__(self) -> str:
        """Name and place, for the log."""
        values = ((field.name, getattr(self, field.name)) for field in fields(self) if field.name != "period")
        said = ", ".join(f"{name} {value}" for name, value in values if value is not None)
        return f"{self.name()}: {said}" if said else self.name()

    def begin(self, device: FaultTarget) -> None:
        """Bring it about; nothing changes if it is there already."""
        raise NotImplementedError

    def end(self, device: FaultTarget) -> None:
        """Undo it, if it ends by itself."""


@dataclass(frozen=True, kw_only=True)
class Lasting(InjectedFault):
    """Something that may end by itself.

    Parameters
    ----------
    periods : int, optional
        How long it lasts; for good by default.
    """

    periods: Periods | None = None
