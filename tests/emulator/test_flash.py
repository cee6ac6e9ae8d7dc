from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from phasewire.base.errors import InputFileError
from phasewire.emulator.firmware.flash import FLASH_BYTES, Flash
from phasewire.emulator.scheduler import Scheduler

MS = 400_000  # core cycles: 400 MHz
SECTOR, PAGE = 4096, 256


def powered(flash: Flash) -> Scheduler:
    scheduler = Scheduler()
    flash.power_up(scheduler)
    return scheduler


def programmed(address: int, data: bytes) -> tuple[Flash, Scheduler]:
    """An idle flash, all ones except for these bytes."""
    flash = Flash()
    scheduler = powered(flash)
    flash.program(address, data)
    scheduler.run_until(MS)
    return flash, scheduler


@pytest.mark.parametrize(
    ("address", "data", "match"),
    [
        (0, b"", "1 to 256"),
        (0, bytes(257), "257 bytes at 000000h; 1 to 256"),
        (0x10FF, bytes(2), "2 bytes at 0010ffh; 1 to 1 can"),
        (FLASH_BYTES - 1, bytes(2), "not within"),
        (-1, bytes(1), "not within"),
    ],
)
def test_programming_stays_within_a_page(address: int, data: bytes, match: str) -> None:
    flash = Flash()
    powered(flash)
    with pytest.raises(ValueError, match=match):
        flash.program(address, data)


@pytest.mark.parametrize("address", [1, 256, FLASH_BYTES, -4096])
def test_erasing_is_by_sectors(address: int) -> None:
    flash = Flash()
    powered(flash)
    with pytest.raises(ValueError, match=r"no sector begins|not within"):
        flash.erase(address)


def test_a_busy_flash_refuses_other_work() -> None:
    flash = Flash()
    scheduler = powered(flash)
    flash.program(0, b"\0")
    with pytest.raises(ValueError, match="busy until cycle 400000; it is cycle 0"):
        flash.erase(0)
    with pytest.raises(ValueError, match="busy until cycle 400000; it is cycle 0"):
        flash.program(1, b"\0")
    scheduler.run_until(MS)
    flash.erase(0)


def test_content_of_another_size_is_refused() -> None:
    with pytest.raises(ValueError, match="4194304 bytes, not 3"):
        Flash(b"abc")


# Power cuts


def between(before: int, now: int, after: int) -> bool:
    """Whether bits changed only in one direction, at the intended places."""
    return now & ~before == 0 and now & after == after


@given(st.binary(min_size=2, max_size=PAGE), st.integers(0, MS - 1), st.integers(0, 2**32))
def test_a_page_cut_short_is_programmed_up_to_a_byte(data: bytes, passed: int, seed: int) -> None:
    flash = Flash(bytes([0xF7]) * FLASH_BYTES, seed=seed)
    scheduler = powered(flash)
    flash.program(0x5000, data)
    scheduler.run_until(passed)
    flash.cut_power()
    now, done = flash.read(0x5000, PAGE), passed * len(data) // MS
    assert now[:done] == bytes(byte & 0xF7 for byte in data[:done])
    assert between(0xF7, now[done], data[done] & 0xF7)
    assert set(now[done + 1 :]) <= {0xF7}
    assert set(flash.read(0, 0x5000)) == {0xF7}


def cut_erasure(passed: int, seed: int = 0, before: int = 0x5A) -> bytes:
    """A sector whose erasure was cut short; the bytes around it are unchanged."""
    flash = Flash(bytes([before]) * FLASH_BYTES, seed=seed)
    scheduler = powered(flash)
    flash.erase(0x7000)
    scheduler.run_until(passed)
    flash.cut_power()
    assert set(flash.read(0x6000, SECTOR) + flash.read(0x8000, SECTOR)) == {before}
    return flash.read(0x7000, SECTOR)


def ones(data: bytes) -> int:
    return int.from_bytes(data, "big").bit_count()


def test_an_erasure_cut_short_leaves_bits_of_both_values() -> None:
    whole = 60 * MS
    assert set(cut_erasure(0)) == {0x5A}
    early, late = cut_erasure(whole // 8), cut_erasure(whole * 3 // 4)
    assert all(byte & ~0x5A == 0 for byte in early)  # on its way to zeros
    assert ones(early) == pytest.approx(SECTOR * 4 / 2, rel=0.05)
    assert set(cut_erasure(whole // 4)) == {0}
    assert ones(late) == pytest.approx(SECTOR * 8 * 2 / 3, rel=0.05)
    assert set(cut_erasure(whole)) == {0xFF}


def test_the_same_cut_leaves_the_same_bytes() -> None:
    at = 40 * MS
    assert cut_erasure(at) == cut_erasure(at)
    assert cut_erasure(at) != cut_erasure(at, seed=1)
    assert cut_erasure(at) != cut_erasure(at + 1)


def test_the_power_fails_at_a_byte_of_a_write() -> None:
    """A sector, then 7 bytes of which three are whole: these take 3/7 of a millisecond, 171 428.6 cycles."""
    flash, blown = Flash(), []
    scheduler = powered(flash)
    flash.cut_power_after(SECTOR + 3, lambda: blown.append(scheduler.now))
    flash.erase(0)
    scheduler.run_until(60 * MS)
    assert not blown
    flash.program(0, bytes(7))
    scheduler.run_until(100 * MS)
    assert blown == [60 * MS + 171_429]
    assert flash.read(0, 3) == bytes(3)
    assert flash.read(4, SECTOR - 4) == b"\xff" * (SECTOR - 4)
    with pytest.raises(ValueError, match="no power"):
        flash.program(0, b"\0")


def test_a_cut_at_a_byte_that_is_never_written_does_not_occur() -> None:
    flash, blown = Flash(), []
    scheduler = powered(flash)
    flash.cut_power_after(8, lambda: blown.append(scheduler.now))
    flash.program(0, bytes(8))
    scheduler.run_until(MS)
    assert flash.read(0, 8) == bytes(8)
    assert not blown
    flash.program(8, bytes(8))
    scheduler.run_until(MS)
    assert blown == [MS]
    with pytest.raises(ValueError, match="after -1 written bytes"):
        flash.cut_power_after(-1)


# Defects


def test_failed_work_changes_nothing_and_is_reported() -> None:
    flash, scheduler = programmed(0x1000, b"\x00")
    flash.defects.failing_sectors.add(1)
    flash.erase(0x1000)
    scheduler.run_until(100 * MS)
    assert flash.failed
    assert flash.read(0x1000, 1) == b"\x00"
    flash.defects.failing_pages.add(0x20)
    flash.program(0x2000, b"\x00")
    scheduler.run_until(101 * MS)
    assert flash.failed
    assert flash.read(0x2000, 1) == b"\xff"
    flash.program(0x2100, b"\x00")
    assert not flash.failed


def test_a_protected_flash_is_not_written() -> None:
    flash = Flash()
    powered(flash)
    assert flash.writable
    flash.defects.write_protected = True
    assert not flash.writable
    with pytest.raises(ValueError, match="write-protected"):
        flash.erase(0)
    with pytest.raises(ValueError, match="write-protected"):
        flash.program(0, b"\0")
    assert not flash.busy


def test_stuck_bits_read_wrong_without_an_error() -> None:
    flash, scheduler = programmed(0, b"\x00\x0f")
    flash.defects.stuck_at_1[0] = 0x81
    flash.defects.stuck_at_0[1] = 0x03
    assert flash.read(0, 2) == b"\x81\x0c"
    assert flash.read(1, 1) == b"\x0c"
    flash.erase(0)
    scheduler.run_until(100 * MS)
    assert flash.read(0, 3) == b"\xff\xfc\xff"
    assert not flash.failed


# Files


def test_its_content_is_kept_in_a_file(tmp_path: Path) -> None:
    path = tmp_path / "flash.bin"
    flash, scheduler = programmed(0x12345, b"phasewire")
    flash.erase(0x3FF000)
    scheduler.run_until(100 * MS)
    flash.save(path)
    assert path.stat().st_size == FLASH_BYTES + 1024 * 4
    assert path.read_bytes()[0x12345:][:9] == b"phasewire"
    loaded = Flash.load(path)
    assert loaded.read(0, FLASH_BYTES) == flash.read(0, FLASH_BYTES)
    assert loaded.erasures.tolist() == [0] * 1023 + [1]
    powered(loaded)
    loaded.erase(0)


@pytest.mark.parametrize(
    ("change", "found"),
    [
        (-1, ": a flash is kept in a file of 4198400 bytes, not 4198399 bytes"),
        (1, " has 4198401 bytes; such a file may have at most 4198400"),
    ],
)
def test_a_file_of_another_kind_is_refused(tmp_path: Path, change: int, found: str) -> None:
    path = tmp_path / "flash.bin"
    path.write_bytes(bytes(FLASH_BYTES + 4096 + change))
    with pytest.raises(InputFileError, match=f"flash.bin{found}"):
        Flash.load(path)
