"""Debian's kernels: fetched once, unpacked, and kept in the user's cache.

Debian's kernel for clouds has no USB, so this is the general one. Its modules are loaded from the kept folder.
Uncompressed, a kernel starts in seconds without KVM. A kernel of another suite than this computer's is found with
separate package lists, so that this computer's configuration does not change.
"""

from __future__ import annotations

import lzma
import os
import re
import shutil
import struct
import subprocess
import tempfile
import time
import zlib
from dataclasses import dataclass
from pathlib import Path

from platformdirs import user_cache_path

__all__ = ["NEWEST", "PACKAGE", "GuestKernel", "fetch_kernel", "missing_programs", "unpack"]

PACKAGE = "linux-image-amd64"
NEWEST = "trixie-backports"
"""Debian's suite with the newest kernel, besides the one of this computer."""
KEYS = Path("/usr/share/keyrings/debian-archive-keyring.gpg")
LIST_SECONDS = 86400.0
"""The age after which a list of packages is fetched again."""
PROGRAMS = {
    "qemu-system-x86_64": "qemu-system-x86",
    "busybox": "busybox-static",
    "cpio": "cpio",
    "depmod": "kmod",
    "ip": "iproute2",
    "apt-get": "apt",
    "dpkg-deb": "dpkg",
    "setpriv": "util-linux",
    "zstd": "zstd",
}
"""What the guest needs of this computer, and the Debian package that contains it."""

EARLY = ("virtio-pci", "9pnet-virtio", "9p", "overlay", "virtio-console", "virtio-net")
"""Modules without which the guest cannot reach this computer's files."""

INIT = Path(__file__).with_name("init.sh")
SETUP_SECTORS, PAYLOAD = 0x1F1, 0x248  # of Documentation/arch/x86/boot.rst
SECTOR_BYTES = 512
ZSTD = b"\x28\xb5\x2f\xfd"
FETCH_SECONDS = 600.0
KEPT_SECONDS = 30 * 86400.0
"""How long unused files stay in the cache."""
MADE = ("linux-image-*", "linux-image-*/initramfs*", "numba/*")
"""What is made again if missing: kernels, their first files, and what was compiled for guests."""


@dataclass(frozen=True)
class GuestKernel:
    """A kernel that can be started."""

    folder: Path
    """Holds ``vmlinux``, ``lib/modules`` and what `initramfs` names."""
    release: str
    """As ``uname -r`` prints it."""

    @property
    def image(self) -> Path:
        """The kernel, uncompressed."""
        return self.folder / "vmlinux"

    @property
    def initramfs(self) -> Path:
        """Its first files; they differ for another `INIT`."""
        return self.folder / f"initramfs-{zlib.crc32(INIT.read_bytes()):08x}"


def missing_programs() -> list[str]:
    """Debian's packages of missing programs that the guest needs."""
    places = "/usr/local/sbin:/usr/sbin:/sbin:/usr/local/bin:/usr/bin:/bin"
    return [package for program, package in PROGRAMS.items() if not shutil.which(program, path=places)]


def fetch_kernel(suite: str | None = None, cache: Path | None = None) -> GuestKernel:
    """Debian's newest kernel of a suite such as `NEWEST`, from a cache if it is there.

    By default the suite is the one from which this computer installs packages, and the cache is the user's. Raises
    `OSError` if the kernel can be neither found nor fetched.
    """
    folder = (cache or user_cache_path("phasewire")) / "guest"
    options = _lists(suite, folder / "lists" / suite) if suite else ()
    packages = _newest(options)
    kernel = GuestKernel(folder / packages[0], packages[0].removeprefix("linux-image-"))
    if not kernel.image.exists():
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=folder) as name:
            built = Path(name) / "built"
            built.mkdir()
            _run("apt-get", *options, "download", "--quiet", *packages, cwd=name)
            for file in Path(name).glob("*.deb"):
                _run("dpkg-deb", "--extract", str(file), f"{name}/files", cwd=name)
            modules, files = built / "lib/modules", Path(name) / "files"
            modules.mkdir(parents=True)
            (built / "vmlinux").write_bytes(unpack(next(files.rglob("vmlinuz*")).read_bytes()))
            shutil.move(next(files.glob(f"**/lib/modules/{kernel.release}/kernel")).parent, modules / kernel.release)
            _run("depmod", "--basedir", str(built), kernel.release, cwd=name)
            shutil.rmtree(kernel.folder, ignore_errors=True)
            built.rename(kernel.folder)
    if not kernel.initramfs.exists():
        _make_initramfs(kernel)
    for used in (kernel.folder, kernel.initramfs):
        os.utime(used)
    _prune(folder)
    return kernel


def _prune(folder: Path) -> None:
    """Remove what no guest has used for long, such as replaced kernels."""
    for path in [each for pattern in MADE for each in folder.glob(pattern)]:
        if path.exists() and time.time() - path.stat().st_mtime > KEPT_SECONDS:
            if path.is_dir():
                shutil.rmtree(path, ignore_errors=True)
            else:
                path.unlink(missing_ok=True)


def unpack(image: bytes) -> bytes:
    """The kernel inside a bzImage; raises `OSError` if it is compressed by neither xz nor zstd, which Debian uses."""
    setup = (image[SETUP_SECTORS] or 4) + 1
    offset, length = struct.unpack_from("<II", image, PAYLOAD)
    begin = setup * SECTOR_BYTES + offset
    payload = image[begin : begin + length]
    try:
        if payload.startswith(ZSTD):  # followed by the length of the kernel
            command = ["zstd", "--decompress", "--stdout"]
            done = subprocess.run(command, input=payload[:-4], capture_output=True, check=True, timeout=FETCH_SECONDS)
            return done.stdout
        return lzma.LZMADecompressor().decompress(payload)
    except (lzma.LZMAError, subprocess.CalledProcessError) as error:
        raise OSError(f"the kernel is compressed by neither xz nor zstd: {error}") from error


def _lists(suite: str, folder: Path) -> tuple[str, ...]:
    """Options by which apt only knows the packages of a suite."""
    sources, fetched = folder / "sources.list", folder / "fetched"
    options = {
        "Dir::Etc": folder,
        "Dir::Etc::SourceList": sources,
        "Dir::Etc::SourceParts": "/dev/null",
        "Dir::Etc::PreferencesParts": "/dev/null",
        "Dir::State": folder / "state",
        "Dir::State::Status": "/dev/null",
        "Dir::Cache": folder / "cache",
        "APT::Sandbox::User": "root",
        "Acquire::Languages": "none",
        "Acquire::Retries": 2,
    }
    given = tuple(part for name, value in options.items() for part in ("--option", f"{name}={value}"))
    if not fetched.exists() or time.time() - fetched.stat().st_mtime > LIST_SECONDS:
        for place in ("state/lists/partial", "cache/archives/partial"):
            (folder / place).mkdir(parents=True, exist_ok=True)
        sources.write_text(f"deb [arch=amd64 signed-by={KEYS}] {_archive()} {suite} main\n")
        try:
            _run("apt-get", *given, "update", "--quiet", "--error-on=any")
            fetched.touch()
        except OSError:
            if not fetched.exists():
                raise
    return given


def _archive() -> str:
    """Debian's archive from which this computer installs packages."""
    known = _run("apt-get", "indextargets", "--format", "$(REPO_URI)", "Identifier: Packages", "Label: Debian").split()
    if not known:
        raise OSError("apt knows no archive of Debian; run apt-get update")
    return known[0]


def _newest(options: tuple[str, ...]) -> list[str]:
    """The package of the newest kernel, and those that newer suites split from it."""
    found = _needed(options, PACKAGE, r"linux-image-\d\S*")
    if not found:
        raise OSError(f"apt knows no {PACKAGE}; run apt-get update")
    return [found[0], *_needed(options, found[0], r"linux-(?:binary|modules)-\d\S*")]


def _needed(options: tuple[str, ...], package: str, pattern: str) -> list[str]:
    """What a package depends on, as far as the name matches."""
    return re.findall(f"Depends: ({pattern})", _run("apt-cache", *options, "depends", "--important", package))


def _make_initramfs(kernel: GuestKernel) -> None:
    """A folder tree of busybox, the first modules, and the program that mounts this computer's files."""
    modules = kernel.folder / "lib/modules" / kernel.release
    needs = {
        line.partition(":")[0]: line.partition(":")[2].split()
        for line in (modules / "modules.dep").read_text().splitlines()
    }
    paths = {Path(path).name.partition(".")[0].replace("_", "-"): path for path in needs}
    order: dict[str, None] = {}  # a module after those that it needs; kmod lists the nearest first

    def add(path: str) -> None:
        for need in reversed(needs[path]):
            add(need)
        order[path] = None

    for name in EARLY:
        if name in paths:  # otherwise it is built into the kernel
            add(paths[name])
    with tempfile.TemporaryDirectory() as name:
        root = Path(name)
        for place in ("bin", "modules", "proc", "sys", "dev", "host", "new", "run"):
            (root / place).mkdir()
        busybox = shutil.which("busybox")
        assert busybox
        shutil.copy(busybox, root / "bin/busybox")
        for path in order:
            data = (modules / path).read_bytes()
            name = Path(path).name.removesuffix(".xz")
            (root / "modules" / name).write_bytes(lzma.decompress(data) if path.endswith(".xz") else data)
        (root / "modules/order").write_text("".join(f"{Path(path).name.removesuffix('.xz')}\n" for path in order))
        shutil.copy(INIT, root / "init")
        (root / "init").chmod(0o755)
        listing = "\n".join(str(path.relative_to(root)) for path in sorted(root.rglob("*")))
        whole = kernel.folder / f"initramfs.{os.getpid()}"
        with whole.open("wb") as archive:
            subprocess.run(
                ["cpio", "--create", "--format=newc", "--quiet"],
                cwd=root, input=listing.encode(), stdout=archive, check=True, timeout=FETCH_SECONDS,
            )  # fmt: skip
        for old in kernel.folder.glob("initramfs-*"):
            old.unlink(missing_ok=True)
        whole.rename(kernel.initramfs)


def _run(*command: str, cwd: str | None = None) -> str:
    try:
        done = subprocess.run(command, cwd=cwd, capture_output=True, text=True, check=True, timeout=FETCH_SECONDS)
    except subprocess.CalledProcessError as error:
        raise OSError(f"{' '.join(command)} failed: {error.stderr.strip()}") from error
    except subprocess.TimeoutExpired as error:
        raise OSError(f"{' '.join(command)} took longer than {FETCH_SECONDS:g} s") from error
    return done.stdout
