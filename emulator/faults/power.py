"""What goes wrong with the power and the flash."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar

from ...protocol.codes import FLASH_SECTOR_BYTES
from ...protocol.dfu import PAGE_BYTES
from ..firmware.flash import FLASH_BYTES
from .fault import FaultTarget, InjectedFault, Lasting
from .limits import ByteBit, Periods, Whole

__all__ = ["FailingPage", "FailingSector", "PowerCut", "PowerCutInWrite", "StuckFlashBit", "WriteProtectedFlash"]


@dataclass(frozen=True, kw_only=True)
class PowerCut(Lasting):
    """A loss of all power, which comes back at the end."""

    unfolds: ClassVar[bool] = False

    def begin(self, device: FaultTarget) -> None:
        """Take the power away."""
        device.power_down()

    def end(self, device: FaultTarget) -> None:
        """Give it back."""
        device.power_up()


@dataclass(frozen=True, kw_only=True)
class PowerCutInWrite(InjectedFault):
    """A loss of all power while the flash is written.

    Parameters
    ----------
    written_bytes : int
        How many more bytes are programmed or, with their sector, erased; it is the next one that is cut short.
    off_periods : int, optional
        Periods until the power comes back; for good by default.
    """

    written_bytes: Annotated[int, Whole(0)]
    off_periods: Periods | None = None

    unfolds: ClassVar[bool] = False

    def begin(self, device: FaultTarget) -> None:
        """Wait for that byte."""
        device.flash.cut_power_after(self.written_bytes, lambda: device.inject(PowerCut(periods=self.off_periods)))


@dataclass(frozen=True, kw_only=True)
class WriteProtectedFlash(Lasting):
    """A flash that takes no command which changes anything."""

    unfolds: ClassVar[bool] = False

    def begin(self, device: FaultTarget) -> None:
        """Protect it."""
        device.flash.defects.write_protected = True

    def end(self, device: FaultTarget) -> None:
        """Protect it no more."""
        device.flash.defects.write_protected = False


@dataclass(frozen=True, kw_only=True)
class FailingSector(Lasting):
    """A sector of the flash that cannot be erased, as the flash says.

    Parameters
    ----------
    sector : int
        Number of the sector of 4096 bytes.
    """

    sector: Annotated[int, Whole(0, FLASH_BYTES // FLASH_SECTOR_BYTES - 1)]

    unfolds: ClassVar[bool] = False

    def begin(self, device: FaultTarget) -> None:
        """Let it fail."""
        device.flash.defects.failing_sectors.add(self.sector)

    def end(self, device: FaultTarget) -> None:
        """Let it work."""
        device.flash.defects.failing_sectors.discard(self.sector)


@dataclass(frozen=True, kw_only=True)
class FailingPage(Lasting):
    """A page of the flash that cannot be programmed, as the flash says.

    Parameters
    ----------
    page : int
        Number of the page of 256 bytes.
    """

    page: Annotated[int, Whole(0, FLASH_BYTES // PAGE_BYTES - 1)]

    unfolds: ClassVar[bool] = False

    def begin(self, device: FaultTarget) -> None:
        """Let it fail."""
        device.flash.defects.failing_pages.add(self.page)

    def end(self, device: FaultTarget) -> None:
        """Let it work."""
        device.flash.defects.failing_pages.discard(self.page)


@dataclass(frozen=True, kw_only=True)
class StuckFlashBit(Lasting):
    """A bit of the flash that always reads the same, which the flash does not notice.

    Parameters
    ----------
    address : int
        Address of its byte.
    bit : int
        Number of the bit in the byte.
    value : int
        What it reads.
    """

    address: Annotated[int, Whole(0, FLASH_BYTES - 1)]
    bit: ByteBit
    value: Annotated[int, Whole(0, 1)]

    unfolds: ClassVar[bool] = False

    def begin(self, device: FaultTarget) -> None:
        """Let it stick."""
        masks = self._masks(device)
        masks[self.address] = masks.get(self.address, 0) | 1 << self.bit

    def end(self, device: FaultTarget) -> None:
        """Let it be as it was written."""
        self._masks(device)[self.address] &= ~(1 << self.bit)

    def _masks(self, device: FaultTarget) -> dict[int, int]:
        defects = device.flash.defects
        return defects.stuck_at_1 if self.value else defects.stuck_at_0
