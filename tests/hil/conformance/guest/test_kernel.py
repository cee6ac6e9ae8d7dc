"""Kernels for the guest, without one: how they are packed, and the folders that apt uses."""

from __future__ import annotations

import lzma
import os
import shutil
import struct
import subprocess
from pathlib import Path

import pytest
from phasewire.hil.conformance.guest import kernel

KERNEL = b"\x7fELF" + bytes(10_000)


def image(payload: bytes) -> bytes:
    """A bzImage as Documentation/arch/x86/boot.rst has it: two sectors of setup, then the payload."""
    setup = bytearray(1024 + 16)
    setup[0x1F1] = 1
    setup[0x248:0x250] = struct.pack("<II", 16, len(payload))
    return bytes(setup) + payload + b"more"


def test_a_kernel_packed_by_xz_is_unpacked() -> None:
    assert kernel.unpack(image(lzma.compress(KERNEL, check=lzma.CHECK_CRC32) + bytes(4))) == KERNEL


@pytest.mark.skipif(not shutil.which("zstd"), reason="zstd is not installed")
def test_a_kernel_packed_by_zstd_is_unpacked() -> None:
    packed = subprocess.run(["zstd", "--stdout"], input=KERNEL, capture_output=True, check=True).stdout
    assert kernel.unpack(image(packed + struct.pack("<I", len(KERNEL)))) == KERNEL


def test_a_kernel_packed_otherwise_is_refused() -> None:
    with pytest.raises(OSError, match="neither xz nor zstd"):
        kernel.unpack(image(b"\x1f\x8b gzip"))


@pytest.mark.skipif(not (shutil.which("busybox") and shutil.which("cpio")), reason="busybox or cpio is not installed")
def test_first_files_take_the_place_of_older_ones(tmp_path: Path) -> None:
    there = kernel.GuestKernel(tmp_path, "6.1-amd64")
    modules = tmp_path / "lib/modules/6.1-amd64"
    modules.mkdir(parents=True)
    for name in (modules / "modules.dep", tmp_path / "initramfs-01234567", tmp_path / "vmlinux"):
        name.touch()
    kernel._make_initramfs(there)
    assert sorted(path for path in tmp_path.iterdir() if path.is_file()) == [there.initramfs, there.image]
    assert there.initramfs.read_bytes().startswith(b"070701"), "the format that the kernel reads"


def test_fetching_another_suite_leaves_the_apt_of_the_computer_unchanged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every folder that apt writes to is in the cache, and old lists are used if new ones cannot be fetched."""
    asked: list[tuple[str, ...]] = []

    def run(*command: str, cwd: str | None = None) -> str:
        if "indextargets" in command:  # what this computer uses is only read
            return "http://archive.example/debian/\n"
        asked.append(command)
        if "update" in command and len(asked) > 2:
            raise OSError("no network")
        if command[-1] == kernel.PACKAGE:
            return "linux-image-amd64\n  Depends: linux-image-7.1-amd64\n"
        return "  Depends: linux-modules-7.1-amd64\n |Depends: <dracut>\n" if "depends" in command else ""

    monkeypatch.setattr(kernel, "_run", run)
    built = tmp_path / "guest/linux-image-7.1-amd64"
    built.mkdir(parents=True)
    there = kernel.GuestKernel(built, "7.1-amd64")
    there.image.touch()
    there.initramfs.touch()
    old, young = (tmp_path / f"guest/linux-image-{release}" for release in ("5.1-amd64", "6.1-amd64"))
    for each in (old, young):
        each.mkdir()
    for each in (old, built):
        os.utime(each, (0, 0))
    assert kernel.fetch_kernel("some-suite", tmp_path) == there
    assert (old.exists(), young.exists(), built.exists()) == (False, True, True), "what is not used any more is removed"
    lists = tmp_path / "guest/lists/some-suite"
    for command in asked:
        options = dict(part.split("=", 1) for part in command if "::" in part)
        assert all(options[name].startswith(str(lists)) for name in ("Dir::Etc", "Dir::State", "Dir::Cache"))
    assert "http://archive.example/debian/ some-suite main" in (lists / "sources.list").read_text()
    monkeypatch.setattr(kernel, "LIST_SECONDS", -1.0)
    assert kernel.fetch_kernel("some-suite", tmp_path).release == "7.1-amd64"
