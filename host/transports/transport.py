"""What a transport is: how blocks and requests reach a device, and how devices are found."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Literal, Protocol

from ...base.errors import DeviceError, ReplyError
from ...protocol.codes import Request

__all__ = [
    "DeviceMode",
    "Found",
    "Scheme",
    "Timekeeper",
    "Transport",
    "understood",
]


@contextmanager
def understood(name: str) -> Iterator[None]:
    """Turn what is wrong with an answer into an error that names the device."""
    try:
        yield
    except ReplyError as error:
        raise DeviceError(f"{name} answers in a way that breaks the protocol: {error}") from error


class Timekeeper(Protocol):
    """A clock, and a way to wait by it. Python's module `time` is one.

    An emulated device in this process has a time of its own, which passes only while it is used or somebody waits.
    """

    def monotonic(self) -> float:
        """Seconds since some moment."""

    def sleep(self, seconds: float, /) -> None:
        """Let time pass."""


class Transport(Protocol):
    """A line to one device. Every method raises a `DeviceError` if the line or the device fails.

    A line is for one thread at a time.
    """

    @property
    def name(self) -> str:
        """What is at the other end, for people."""

    @property
    def serial(self) -> str:
        """Its serial number, empty if the line cannot tell."""

    @property
    def time(self) -> Timekeeper:
        """The time by which this line is waited for."""

    @property
    def lossy(self) -> bool:
        """Whether blocks and their acknowledgements can be lost on the way, as on a serial line."""

    @property
    def posts(self) -> bool:
        """Whether the line takes blocks before the device does, and carries them while this program does other things.

        `write_blocks` then returns as soon as the line has them. A line that wraps such a one answers False only if its
        own `write_blocks` waits until the device has taken the blocks.
        """

    @property
    def most_blocks_per_second(self) -> float:
        """What the line can carry."""

    def window(self, free: int | None, records: int) -> int:
        """How many blocks may be unanswered at a time.

        Parameters
        ----------
        free : int or None
            Free places of the newest acknowledgement, None before the first.
        records : int
            Acknowledgements that the device can hold, as INFO says.
        """

    def write_blocks(self, blocks: bytes, seconds: float) -> int:
        """Send blocks of 512 bytes, one after the other.

        Returns
        -------
        int
            Bytes taken in time, whole blocks; fewer than all only if the time is over.
        """

    def read_records(self, seconds: float) -> bytes:
        """Wait for what the device sends by itself: whole records, none if none came in time."""

    def take_back(self) -> int:
        """Drop the blocks that the line has not sent yet; returns their number of bytes, 0 if `posts` is false."""

    def query(self, request: Request, size: int) -> bytes:
        """Make a control request that is answered with up to ``size`` bytes."""

    def command(self, request: Request, value: int = 0) -> None:
        """Make a control request that is only carried out."""

    def reopen(self, seconds: float) -> None:
        """Find the same device again after it was lost or restarted. Wait at most ``seconds`` for it."""

    def close(self) -> None:
        """Close the line."""


DeviceMode = Literal["run time", "DFU"]


@dataclass(frozen=True)
class Found:
    """A device that could be opened, or what speaks against it.

    Parameters
    ----------
    url : str
        The URL by which it is opened.
    product : str
        Its name, empty if it cannot be read.
    serial : str or None
        Its serial number, None if it cannot be read.
    mode : {"run time", "DFU"}
        Whether it plays, or waits for new firmware.
    firmware : str
        Version of its firmware, empty if the line does not say.
    location : str
        The place where it is plugged in, for people.
    problem : str or None
        Why it cannot be opened, and what to do; None if nothing is known to be wrong.
    """

    url: str
    product: str
    serial: str | None
    mode: DeviceMode
    firmware: str
    location: str
    problem: str | None = None


class Scheme(Protocol):
    """All lines whose URLs begin alike."""

    def open(self, url: str) -> Transport:
        """Open the line that a URL names; raise a `DeviceError` if nothing answers or it may not be used."""

    def find(self) -> list[Found]:
        """The devices that can be found without knowing where they are."""
