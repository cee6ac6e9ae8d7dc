"""The guest: QEMU without KVM, with read access to the computer's files, and commands that run in it."""

from __future__ import annotations

import json
import os
import select
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from ....host.transports.vhci import PORT
from .kernel import GuestKernel

__all__ = ["BOUND", "SERVER", "Done", "Guest", "GuestError"]

SERVER = ("10.0.2.100", PORT)
"""The address of the USB/IP server of `Guest.serve` in the guest."""
REDIRECTED = "redirected"
"""QEMU's names for the device of `Guest.plug`, and its connection."""

SHARED = "/run/guest"
"""The writable folder in the guest."""
BOOT_SECONDS = 420.0
"""It takes 20 s on a quiet computer, and more than 240 s beside ten busy processes on two cores."""
ANSWER_SECONDS = 180.0
"""How much longer than its command the guest may take to answer."""
LIFE_SECONDS = 7200
"""Time after which QEMU is killed in any case."""
MOST_FILE_BYTES = 64 << 20
"""The longest file that QEMU may write, its logs and the guest's shared files included; then it is killed."""
MOST_LOG_BYTES = 1 << 20
BOUND = ("setpriv", "--pdeathsig", "KILL")
"""Ends a program when its parent has ended, however that came about."""
PROCESSOR = {"NUMBA_CPU_NAME": "x86-64", "NUMBA_CPU_FEATURES": ""}
"""What the guest's kernels are compiled for, so that this computer, which is faster, can compile them.

QEMU calls a function for most vector instructions: made for AVX2, the kernel that packs blocks takes four times as
long.
"""
EMULATED = "max,-erms"
"""QEMU's processor. QEMU copies byte by byte where ERMS is announced, and Linux then copies so: seven times as long."""
WARM_UP = ("stream", "play")
"""Commands that need the host's compiled kernels; a guest without KVM takes minutes to compile them."""
WARM_UP_SECONDS = 600.0
HERE = Path(__file__).parent
ROOT = HERE.parents[2]


class GuestError(Exception):
    """The guest does not start, or no longer answers."""


@dataclass(frozen=True)
class Done:
    """A command that has ended."""

    code: int
    """Its exit code; negative if a signal ended it."""
    out: str
    err: str
    """Its output."""


class Guest:
    """A Linux machine in QEMU, from the entry of a ``with`` statement to its end.

    Parameters
    ----------
    kernel : GuestKernel
        Its kernel.
    memory_mib : int
        Its memory.

    Attributes
    ----------
    boot_seconds : float
        Time until it could run commands.
    """

    def __init__(self, kernel: GuestKernel, memory_mib: int = 2048) -> None:
        self._kernel, self._memory = kernel, memory_mib
        self._running: set[int] = set()
        self._waiting: dict[int, Done] = {}
        self._number = 0
        self._received = b""
        self._lost = ""
        self.boot_seconds = 0.0

    def __enter__(self) -> Self:
        self._folder = Path(tempfile.mkdtemp(prefix="phasewire-guest-"))
        try:
            self._start()
        except BaseException:
            self._stop()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._stop()

    @property
    def log(self) -> str:
        """The output of its kernel and first programs on the serial console."""
        with (self._folder / "console").open("rb") as file:
            return file.read(MOST_LOG_BYTES).decode(errors="replace")

    def serve(self, port: int) -> None:
        """From now on lead the guest's connections to `SERVER` to a TCP port of this computer."""
        (self._folder / "port").write_text(str(port))

    def share(self, name: str, data: bytes) -> str:
        """Give the guest a file; returns its path there."""
        (self._folder / "work" / name).write_bytes(data)
        return f"{SHARED}/{name}"

    def plug(self, port: int) -> None:
        """Plug the device that a TCP port of this computer offers by usbredir into the guest's EHCI host controller."""
        server = {"type": "inet", "data": {"host": "127.0.0.1", "port": str(port)}}
        backend = {"type": "socket", "data": {"addr": server, "server": False}}
        self._tell("chardev-add", id=REDIRECTED, backend=backend)
        self._tell("device_add", driver="usb-redir", id=REDIRECTED, bus="ehci.0", chardev=REDIRECTED)

    def unplug(self) -> None:
        """Unplug the device of `plug`."""
        self._tell("device_del", id=REDIRECTED)

    def run(self, *command: str, seconds: float = 60.0) -> Done:
        """Run a command in the guest, and wait for its end; it is interrupted after so many seconds.

        ``phasewire`` begins at once, as its modules have been imported; so does ``python``, followed by the text of a
        program.
        """
        return self.wait(self.start(*command, seconds=seconds), seconds)

    def start(self, *command: str, seconds: float = 60.0) -> int:
        """Start a command in the guest; returns its number for `wait`."""
        self._number += 1
        self._running.add(self._number)
        self._ask({"id": self._number, "command": command, "seconds": seconds})
        return self._number

    def signal(self, number: int, what: signal.Signals = signal.SIGINT) -> None:
        """Send a command a signal; by default interrupt it, as Ctrl-C does."""
        self._ask({"id": number, "signal": int(what)})

    def end_all(self) -> None:
        """End all commands that still run."""
        for number in (running := sorted(self._running)):
            self.signal(number, signal.SIGKILL)
        for number in running:
            self.wait(number)

    def wait(self, number: int, seconds: float = 60.0) -> Done:
        """Wait until a command has ended; raises `GuestError` if the guest does not answer."""
        end = time.monotonic() + seconds + ANSWER_SECONDS
        while number not in self._waiting:
            self._listen(end - time.monotonic())
        return self._waiting.pop(number)

    def _start(self) -> None:
        began = time.monotonic()
        work = self._folder / "work"
        work.mkdir()
        shutil.copy(HERE / "begin.sh", work)
        settings = {
            "MODULES": self._kernel.folder / "lib/modules",
            "RULES": ROOT / "host/finding/60-phasewire.rules",
            "PROJECT": ROOT,
            "PYTHON": sys.executable,
            **self._warm_up(),
        }
        (work / "settings").write_text("".join(f"{name}='{value}'\n" for name, value in settings.items()))
        relay = self._folder / "relay.sh"
        relay.write_text(f"exec {sys.executable} -I -S {HERE}/relay.py {self._folder}/port\n")
        listener = socket.socket(socket.AF_UNIX)
        listener.bind(str(self._folder / "agent"))
        listener.listen(1)
        network = f"user,id=net,restrict=on,guestfwd=tcp:{SERVER[0]}:{SERVER[1]}-cmd:/bin/sh {relay}"
        command = [
            *BOUND, "timeout", "--foreground", "--signal=KILL", str(LIFE_SECONDS),
            *BOUND, "prlimit", f"--fsize={MOST_FILE_BYTES}", "--core=0", "qemu-system-x86_64",
            "-accel", "tcg,thread=multi", "-cpu", EMULATED, "-smp", "2", "-m", str(self._memory),
            "-nodefaults", "-no-user-config", "-display", "none", "-no-reboot",
            "-kernel", str(self._kernel.image), "-initrd", str(self._kernel.initramfs),
            "-append", "console=ttyS0 quiet panic=-1 mitigations=off",
            "-serial", f"file:{self._folder}/console",
            "-virtfs", "local,path=/,mount_tag=host,security_model=none,readonly=on,multidevs=remap",
            "-virtfs", f"local,path={work},mount_tag=work,security_model=none",
            "-device", "virtio-serial-pci", "-chardev", f"socket,id=agent,path={self._folder}/agent",
            "-device", "virtserialport,chardev=agent",
            "-netdev", network, "-device", "virtio-net-pci,netdev=net,romfile=",
            "-device", "usb-ehci,id=ehci", "-qmp", f"unix:{self._folder}/monitor,server=on,wait=off",
        ]  # fmt: skip
        errors = (self._folder / "errors").open("wb")
        self._qemu = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=errors, stderr=errors, start_new_session=True
        )
        listener.settimeout(BOOT_SECONDS)
        try:
            self._line, _ = listener.accept()
        except TimeoutError:
            raise GuestError(f"QEMU does not start: {(self._folder / 'errors').read_text()}") from None
        finally:
            listener.close()
            errors.close()
        self.wait(0, BOOT_SECONDS)
        self.boot_seconds = time.monotonic() - began

    def _warm_up(self) -> dict[str, str]:
        """Compile the host's kernels and modules for the guest; returns the settings that locate them."""
        settings = {**PROCESSOR, "NUMBA_CACHE_DIR": str(self._kernel.folder.parent / "numba")}
        environment = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
        for command in WARM_UP:
            options = ("circle:radius=0.02", "--seconds", "0.01", "--device", "emulator:")
            subprocess.run(
                [*BOUND, sys.executable, "-m", "phasewire", command, *options],
                env=environment | settings, cwd=self._folder, capture_output=True, timeout=WARM_UP_SECONDS, check=True,
            )  # fmt: skip
        return settings

    def _tell(self, command: str, **arguments: Any) -> None:
        """Let QEMU itself carry out a command, in its machine protocol (docs/interop/qmp-spec)."""
        with socket.socket(socket.AF_UNIX) as line, line.makefile("rw") as file:
            line.settimeout(ANSWER_SECONDS)
            line.connect(str(self._folder / "monitor"))
            for request in ({"execute": "qmp_capabilities"}, {"execute": command, "arguments": arguments}):
                file.write(json.dumps(request) + "\n")
                file.flush()
                answers: Iterator[dict[str, Any]] = (json.loads(text) for text in file)
                answer = next((each for each in answers if each.keys() & {"return", "error"}), {})
                if "return" not in answer:
                    raise GuestError(f"QEMU refuses {request}: {answer}")

    def _ask(self, request: dict[str, Any]) -> None:
        self._line.sendall(json.dumps(request).encode() + b"\n")

    def _listen(self, seconds: float) -> None:
        """Take the agent's answers; a guest that failed to answer once is not asked again."""
        data = b""
        if not self._lost:
            if seconds <= 0 or not select.select([self._line], [], [], seconds)[0]:
                self._lost = "the guest does not answer"
            elif not (data := self._line.recv(1 << 16)):
                self._lost = "the guest has ended"
        if self._lost:
            raise GuestError(f"{self._lost}; its console said:\n{self.log[-2000:]}")
        *lines, self._received = (self._received + data).split(b"\n")
        for line in lines:
            answer: dict[str, Any] = json.loads(line)
            self._running.discard(answer["id"])
            self._waiting[answer["id"]] = Done(answer["code"], answer["out"], answer["err"])

    def _stop(self) -> None:
        if hasattr(self, "_qemu"):
            self._qemu.kill()  # and so QEMU, its child
            self._qemu.wait()
        if hasattr(self, "_line"):
            self._line.close()
        shutil.rmtree(self._folder, ignore_errors=True)
