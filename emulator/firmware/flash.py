"""A serial NOR flash: sectors that are erased, pages that are programmed, and what a power cut leaves half done.

It knows neither images nor banks; `loader.py` and `dfu.py` say what lies where. Its cells outlive the power, its clock
does not: between `power_up` and `cut_power` it counts in core cycles, as everything else in the device.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import NamedTuple, Self

import numpy as np
from numpy.random import default_rng  # not when it is used: a Ctrl-C would be lost while it loads
from numpy.typing import NDArray

from ...base.errors import InputFileError
from ...base.storage import FilePath, read_file, write_file
from ...protocol.board import CYCLES_PER_MS
from ...protocol.codes import FLASH_BANK_BYTES, FLASH_SECTOR_BYTES, Bank
from ...protocol.dfu import PAGE_BYTES, PAGE_PROGRAM_MS, SECTOR_ERASE_MS
from ..scheduler import Scheduler

__all__ = ["CYCLES_PER_MS", "FLASH_BYTES", "Defects", "Flash", "FlashTimes"]

FLASH_BYTES = (1 + len(Bank)) * FLASH_BANK_BYTES
SECTORS = FLASH_BYTES // FLASH_SECTOR_BYTES
ERASED_BYTE = 0xFF

# Cells are first programmed to 0, all of them, so that the erasure that follows finds them alike. How much of the time
# that takes is no figure of a data sheet, but assumed.
PREPROGRAMMING_SHARE = 0.25


class FlashTimes(NamedTuple):
    """How long the flash takes, in ms: by default what is typical (clause DFU-008)."""

    erase_ms: int = SECTOR_ERASE_MS
    program_ms: int = PAGE_PROGRAM_MS


@dataclass
class Defects:
    """What is wrong with a flash; nothing by default. It may change while the flash works.

    Parameters
    ----------
    write_protected : bool
        Whether it takes no command that changes anything.
    failing_sectors : set of int
        Sectors, from 0, that stay as they are when they are erased; the flash says so.
    failing_pages : set of int
        Pages, from 0, that stay as they are when they are programmed; the flash says so.
    stuck_at_0, stuck_at_1 : dict of int to int
        Masks, by address, of the bits that always read so. The flash does not notice.
    """

    write_protected: bool = False
    failing_sectors: set[int] = field(default_factory=set)
    failing_pages: set[int] = field(default_factory=set)
    stuck_at_0: dict[int, int] = field(default_factory=dict)
    stuck_at_1: dict[int, int] = field(default_factory=dict)


class _Operation(NamedTuple):
    """An erasure or a programming that was begun, in core cycles; the cells already hold what it leads to."""

    begins: int
    ends: int
    address: int
    before: NDArray[np.uint8]
    is_erasure: bool


class _Fuse(NamedTuple):
    """After how many more written bytes the power fails, and who is told."""

    bytes_left: int
    blown: Callable[[], None]


class Flash:
    """A serial NOR flash of 4 MiB: sectors of 4096 bytes, pages of 256 (clause FWU-016).

    Parameters
    ----------
    content : bytes, optional
        What its cells hold; all ones by default.
    times : FlashTimes
        How long it takes to erase and to program.
    seed : int
        Decides, with the place and its wear, what an operation leaves behind that was cut short.

    Attributes
    ----------
    defects : Defects
        What is wrong with it.
    erasures : (1024,) uint32
        How often each sector was erased, or begun to be.
    busy_until : int
        Core cycle at which the last operation is over.
    failed : bool
        Whether the flash says that the last operation failed; it is known when that is over.
    on_change : callable or None
        What is told the address of each operation that has changed something, when it is over or its power is cut.

    Raises
    ------
    ValueError
        If the content has another size.
    """

    def __init__(
        self, content: bytes | NDArray[np.uint8] | None = None, *, times: FlashTimes | None = None, seed: int = 0
    ) -> None:
        if content is not None and len(content) != FLASH_BYTES:
            raise ValueError(f"a flash holds {FLASH_BYTES} bytes, not {len(content)}")
        self.times = times or FlashTimes()
        self.defects = Defects()
        self.erasures: NDArray[np.uint32] = np.zeros(SECTORS, np.uint32)
        self.busy_until = 0
        self.failed = False
        self.on_change: Callable[[int], None] | None = None
        if content is None:
            self._cells = np.full(FLASH_BYTES, ERASED_BYTE, np.uint8)
        else:
            self._cells = np.array(np.frombuffer(content, np.uint8))
        self._seed = seed
        self._scheduler: Scheduler | None = None
        self._operation: _Operation | None = None
        self._fuse: _Fuse | None = None

    @classmethod
    def load(cls, path: FilePath, *, times: FlashTimes | None = None, seed: int = 0) -> Self:
        """Read a flash from a file: its bytes, and after them how often each sector was erased.

        Raises
        ------
        InputFileError
            If the file has another size.
        OSError
            If it cannot be read.
        """
        size = FLASH_BYTES + 4 * SECTORS
        data = read_file(path, size)
        if len(data) != size:
            raise InputFileError(f"{path}: a flash is kept in a file of {size} bytes, not {len(data)} bytes")
        flash = cls(data[:FLASH_BYTES], times=times, seed=seed)
        flash.erasures[:] = np.frombuffer(data, "<u4", offset=FLASH_BYTES)
        return flash

    def save(self, path: FilePath) -> None:
        """Write what `load` reads; an operation that is not over counts as if it were.

        Raises
        ------
        OSError
            If the file cannot be written; what stood there is untouched.
        """
        write_file(path, self._cells.tobytes() + self.erasures.astype("<u4").tobytes())

    # Power

    def power_up(self, scheduler: Scheduler) -> None:
        """Apply power; the flash is idle and takes its time from the scheduler."""
        self._scheduler = scheduler
        self.busy_until = scheduler.now
        self.failed = False

    def cut_power(self) -> None:
        """Take the power away, now: what is under way stays half done. Nothing happens if there is none."""
        operation, under_way = self._operation, self.busy
        if operation is not None and under_way:
            self._leave_half_done(operation, self._clock.now)
            self._tell(operation)
        self._scheduler = self._operation = self._fuse = None

    def cut_power_after(self, written_bytes: int, blown: Callable[[], None] = lambda: None) -> None:
        """Let the power fail by itself within the byte that follows so many written ones.

        Parameters
        ----------
        written_bytes : int
            Bytes that are still programmed or, with a sector, erased before.
        blown : callable
            What else happens at that moment; the flash has lost its power by then.

        Raises
        ------
        ValueError
            If the number is negative.
        """
        if written_bytes < 0:
            raise ValueError(f"the power cannot fail after {written_bytes} written bytes; at least 0")
        self._fuse = _Fuse(written_bytes, blown)

    @property
    def busy(self) -> bool:
        """Whether an operation is under way."""
        return self._scheduler is not None and self._scheduler.now < self.busy_until

    @property
    def writable(self) -> bool:
        """Whether it takes commands that change something."""
        return not self.defects.write_protected

    @property
    def _clock(self) -> Scheduler:
        if self._scheduler is None:
            raise ValueError("the flash has no power")
        return self._scheduler

    # What it is told to do

    def read(self, address: int, size: int) -> bytes:
        """What stands at an address, with or without power. Of an operation under way it is what that leads to."""
        _check_range(address, size)
        data = bytearray(self._cells[address : address + size].tobytes())
        for at, mask in self.defects.stuck_at_0.items():
            if address <= at < address + size:
                data[at - address] &= ~mask
        for at, mask in self.defects.stuck_at_1.items():
            if address <= at < address + size:
                data[at - address] |= mask
        return bytes(data)

    def erase(self, address: int) -> None:
        """Begin to erase the sector at an address: all its bits become 1.

        Raises
        ------
        ValueError
            If no sector begins there, the flash is busy, write-protected or has no power.
        """
        _check_range(address, FLASH_SECTOR_BYTES)
        sector, within = divmod(address, FLASH_SECTOR_BYTES)
        if within:
            raise ValueError(f"no sector begins at {address:06x}h: they have {FLASH_SECTOR_BYTES} bytes")
        after = np.full(FLASH_SECTOR_BYTES, ERASED_BYTE, np.uint8)
        self._begin(address, after, self.times.erase_ms, sector in self.defects.failing_sectors, is_erasure=True)
        self.erasures[sector] += 1

    def program(self, address: int, data: bytes) -> None:
        """Begin to program bytes of one page: bits that are 0 in the data become 0, no bit becomes 1.

        Raises
        ------
        ValueError
            If the data are empty or reach beyond the page, or the flash is busy, write-protected or has no power.
        """
        _check_range(address, len(data))
        page, within = divmod(address, PAGE_BYTES)
        if not 0 < len(data) <= PAGE_BYTES - within:
            raise ValueError(
                f"{len(data)} bytes at {address:06x}h; 1 to {PAGE_BYTES - within} can be programmed, to the page's end"
            )
        after = self._cells[address : address + len(data)] & np.frombuffer(data, np.uint8)
        self._begin(address, after, self.times.program_ms, page in self.defects.failing_pages, is_erasure=False)

    def _begin(self, address: int, after: NDArray[np.uint8], ms: int, fails: bool, *, is_erasure: bool) -> None:
        if self.busy:
            raise ValueError(f"the flash is busy until cycle {self.busy_until}; it is cycle {self._clock.now}")
        if not self.writable:
            raise ValueError("the flash is write-protected")
        now = self._clock.now
        self.busy_until = now + ms * CYCLES_PER_MS
        self.failed = fails
        self._operation = None
        if not fails:
            place = slice(address, address + after.size)
            self._operation = _Operation(now, self.busy_until, address, self._cells[place].copy(), is_erasure)
            self._cells[place] = after
            if self.on_change is not None:
                self._clock.at(self.busy_until, partial(self._tell, self._operation))
        self._burn(after.size)

    def _tell(self, operation: _Operation) -> None:
        if self._operation is operation and self.on_change is not None:  # otherwise the power was cut before
            self.on_change(operation.address)

    # Power cuts

    def _burn(self, size: int) -> None:
        """Count the bytes of an operation that begins; one of them may be where the power fails."""
        if self._fuse is None:
            return
        if self._fuse.bytes_left >= size:
            self._fuse = self._fuse._replace(bytes_left=self._fuse.bytes_left - size)
            return
        now = self._clock.now
        # The first cycle at which so many bytes are done.
        fails_at = now - -(self._fuse.bytes_left * (self.busy_until - now)) // size
        self._clock.at(fails_at, partial(self._blow, self._fuse))

    def _blow(self, fuse: _Fuse) -> None:
        if self._fuse is fuse:  # otherwise the power was cut before
            self.cut_power()
            fuse.blown()

    def _leave_half_done(self, operation: _Operation, now: int) -> None:
        place = slice(operation.address, operation.address + operation.before.size)
        passed, lasts = now - operation.begins, operation.ends - operation.begins
        wear = int(self.erasures[operation.address // FLASH_SECTOR_BYTES])
        random = default_rng((self._seed, operation.address, wear, passed))
        if operation.is_erasure:
            self._cells[place] = _half_erased(operation.before, passed / lasts, random)
        else:
            done = passed * operation.before.size // lasts
            self._cells[place] = _half_programmed(operation.before, self._cells[place], done, random)


def _check_range(address: int, size: int) -> None:
    if address < 0 or size < 0 or address + size > FLASH_BYTES:
        raise ValueError(f"{size} bytes at {address:06x}h are not within a flash of {FLASH_BYTES} bytes")


def _half_programmed(
    before: NDArray[np.uint8], after: NDArray[np.uint8], done: int, random: np.random.Generator
) -> NDArray[np.uint8]:
    """Bytes are programmed one after the other: some are done, one is half done, of which any bits may be 0 already."""
    cells = np.concatenate([after[:done], before[done:]])
    cells[done] &= after[done] | random.integers(256, dtype=np.uint8)
    return cells


def _half_erased(before: NDArray[np.uint8], progress: float, random: np.random.Generator) -> NDArray[np.uint8]:
    """All cells go to 0 and then to 1, each of them sooner or later than the others."""
    turns = random.random(before.size * 8)
    if progress < PREPROGRAMMING_SHARE:
        return np.packbits(np.unpackbits(before) & (turns >= progress / PREPROGRAMMING_SHARE))
    return np.packbits(turns < (progress - PREPROGRAMMING_SHARE) / (1 - PREPROGRAMMING_SHARE))
