"""Debian's kernel: fetched once, unpacked, and kept in the user's cache.

The kernel that Debian has for clouds has no USB, so this is the one for all computers. Its modules are loaded from the
folder that is kept. A kernel that is not compressed starts in seconds without KVM.
"""

from __future__ import annotations

import lzma
import shutil
import struct
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path

from platformdirs import user_cache_path

__all__ = ["PACKAGE", "Kernel", "fetch_kernel", "missing_programs", "unpack"]

PACKAGE = "linux-image-amd64"
PROGRAMS = {
    "qemu-system-x86_64": "qemu-system-x86",
    "busybox": "busybox-static",
    "cpio": "cpio",
    "depmod": "kmod",
    "ip": "iproute2",
    "apt-get": "apt",
    "dpkg-deb": "dpkg",
}
"""What the guest needs of this computer, and Debian's package that has it."""

EARLY = ("virtio-pci", "9pnet-virtio", "9p", "overlay", "virtio-console", "virtio-net")
"""Modules without which the guest cannot reach this computer's files."""

SETUP_SECTORS, PAYLOAD = 0x1F1, 0x248  # of Documentation/arch/x86/boot.rst
SECTOR_BYTES = 512
FETCH_SECONDS = 600.0


@dataclass(frozen=True)
class Kernel:
    """A kernel that can be started.

    Parameters
    ----------
    folder : Path
        Holds ``vmlinux``, ``initramfs`` and ``lib/modules``.
    release : str
        As ``uname -r`` says it.
    """

    folder: Path
    release: str

    @property
    def image(self) -> Path:
        """The kernel, not compressed."""
        return self.folder / "vmlinux"

    @property
    def initramfs(self) -> Path:
        """The first files that it sees."""
        return self.folder / "initramfs"


def missing_programs() -> list[str]:
    """Debian's packages of which the guest needs programs that are not installed."""
    places = "/usr/local/sbin:/usr/sbin:/sbin:/usr/local/bin:/usr/bin:/bin"
    return [package for program, package in PROGRAMS.items() if not shutil.which(program, path=places)]


def fetch_kernel(cache: Path | None = None) -> Kernel:
    """Debian's newest kernel, from the cache if it is there.

    Parameters
    ----------
    cache : Path, optional
        Where it is kept; by default in the user's cache.

    Raises
    ------
    OSError
        If it can be neither found nor fetched.
    """
    folder = (cache or user_cache_path("phasewire")) / "guest"
    package = _newest()
    kernel = Kernel(folder / package, package.removeprefix("linux-image-"))
    if not kernel.initramfs.exists():
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=folder) as name:
            built = Path(name) / "built"
            built.mkdir()
            _run("apt-get", "download", "--quiet", package, cwd=name)
            (file,) = Path(name).glob("*.deb")
            _run("dpkg-deb", "--extract", str(file), f"{name}/files", cwd=name)
            (built / "lib").mkdir()
            shutil.move(f"{name}/files/lib/modules", built / "lib/modules")
            _run("depmod", "--basedir", str(built), kernel.release, cwd=name)
            image = Path(name) / f"files/boot/vmlinuz-{kernel.release}"
            (built / "vmlinux").write_bytes(unpack(image.read_bytes()))
            _make_initramfs(built, kernel.release)
            shutil.rmtree(kernel.folder, ignore_errors=True)
            built.rename(kernel.folder)
    return kernel


def unpack(image: bytes) -> bytes:
    """The kernel that a bzImage carries.

    Raises
    ------
    OSError
        If it is not compressed by xz, as Debian's is.
    """
    setup = (image[SETUP_SECTORS] or 4) + 1
    offset, length = struct.unpack_from("<II", image, PAYLOAD)
    begin = setup * SECTOR_BYTES + offset
    try:
        return lzma.LZMADecompressor().decompress(image[begin : begin + length])
    except lzma.LZMAError as error:
        raise OSError(f"the kernel is not compressed by xz: {error}") from error


def _newest() -> str:
    """The package of the newest kernel."""
    told = _run("apt-cache", "depends", "--important", PACKAGE)
    found = [line.split()[-1] for line in told.splitlines() if "Depends: linux-image-" in line]
    if not found:
        raise OSError(f"apt knows no {PACKAGE}; run apt-get update")
    return found[0]


def _make_initramfs(folder: Path, release: str) -> None:
    """A folder tree of busybox, the first modules, and the program that mounts this computer's files."""
    modules = folder / "lib/modules" / release
    needs = {
        line.partition(":")[0]: line.partition(":")[2].split()
        for line in (modules / "modules.dep").read_text().splitlines()
    }
    paths = {Path(path).stem.replace("_", "-"): path for path in needs}
    order: dict[str, None] = {}  # a module after those that it needs; kmod lists the nearest first

    def add(path: str) -> None:
        for need in reversed(needs[path]):
            add(need)
        order[path] = None

    for name in EARLY:
        add(paths[name])
    with tempfile.TemporaryDirectory() as name:
        root = Path(name)
        for place in ("bin", "modules", "proc", "sys", "dev", "host", "new", "run"):
            (root / place).mkdir()
        busybox = shutil.which("busybox")
        assert busybox
        shutil.copy(busybox, root / "bin/busybox")
        for path in order:
            shutil.copy(modules / path, root / "modules")
        (root / "modules/order").write_text("".join(f"{Path(path).name}\n" for path in order))
        shutil.copy(Path(__file__).with_name("init.sh"), root / "init")
        (root / "init").chmod(0o755)
        listing = "\n".join(str(path.relative_to(root)) for path in sorted(root.rglob("*")))
        with (folder / "initramfs").open("wb") as archive:
            subprocess.run(
                ["cpio", "--create", "--format=newc", "--quiet"],
                cwd=root, input=listing.encode(), stdout=archive, check=True, timeout=FETCH_SECONDS,
            )  # fmt: skip


def _run(*command: str, cwd: str | None = None) -> str:
    try:
        done = subprocess.run(command, cwd=cwd, capture_output=True, text=True, check=True, timeout=FETCH_SECONDS)
    except subprocess.CalledProcessError as error:
        raise OSError(f"{' '.join(command)} failed: {error.stderr.strip()}") from error
    except subprocess.TimeoutExpired as error:
        raise OSError(f"{' '.join(command)} took longer than {FETCH_SECONDS:g} s") from error
    return done.stdout
