"""Runs in the guest: carries out requests of the computer, as JSON lines on a virtual serial port.

A request is ``{"id": 1, "command": ["lsusb"], "seconds": 10}``. Its answer comes when the command has ended:
``{"id": 1, "code": 0, "out": "", "err": ""}``. ``{"id": 1, "signal": 2}`` sends it a signal. Commands run side by side.
Without KVM the project's modules take many seconds to import, so ``phasewire``, and programs in Python (the command is
``["python", TEXT]``), run in forks of this process, which has imported them once.
"""

from __future__ import annotations

import gc
import json
import os
import runpy
import signal
import sys
import tempfile
import threading
import traceback
from contextlib import suppress
from importlib import import_module
from importlib.metadata import entry_points
from typing import IO, Any, BinaryIO

PHASEWIRE, PYTHON = "phasewire", "python"
COMMANDS = ("attach", "commands", "device", "discovery", "firmware", "flash", "playing", "tracker")
"""The modules of the commands that programs in the guest call."""
OTHERS = ("serial.tools.list_ports", "typer._adapters", "usb.backend.libusb1", "usb.core")
"""Further modules that most programs in the guest need, which libraries load late."""
LATE = {
    "conformance": "phasewire.hil.conformance.running",
    "play": "phasewire.protocol.kernels",
    "show": "phasewire.protocol.kernels",
    "stream": "phasewire.protocol.kernels",
}
"""Modules that single commands need in addition."""
PLUGINS = ("phasewire.transports", "phasewire.usb_backends", "phasewire.serial_ports")
GRACE_SECONDS = 10.0
NOT_STARTED = 127  # as a shell reports it
MOST_OUTPUT_BYTES = 4 << 20
"""How much of a command's output is kept."""
lock = threading.Lock()


def main(port: str) -> None:
    """Serve the port until the guest is turned off."""
    load()
    gc.freeze()  # the memory that all forks share is never written again
    with open(port, "r+b", buffering=0) as line:  # noqa: PTH123  # a device
        _say(line, {"id": 0, "code": 0, "out": "ready", "err": ""})
        children: dict[int, int] = {}
        for text in iter(line.readline, b""):
            request = json.loads(text)
            if "signal" in request:
                _end(children[request["id"]], request["signal"])
                continue
            for word in LATE.keys() & set(request["command"]):
                import_module(LATE[word])
            outputs = _file(), _file()
            child = os.fork()
            if not child:
                _become(request["command"], *(file.fileno() for file in outputs))
            children[request["id"]] = child
            threading.Thread(target=_wait, args=(line, request, child, outputs), daemon=True).start()


def load() -> None:
    """Import what the host's commands need, once for all forks."""
    for name in COMMANDS:
        import_module(f"phasewire.cli.{name}")
    for name in OTHERS:
        import_module(name)
    for group in PLUGINS:
        for entry in entry_points(group=group):
            entry.load()


def _file() -> IO[bytes]:
    return tempfile.TemporaryFile()  # another thread closes it


def _become(command: list[str], out: int, err: int) -> None:
    """Run as a command, in a process and a group of its own."""
    code = 1
    try:
        os.setsid()
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        os.dup2(out, 1)
        os.dup2(err, 2)
        if command[0] == PYTHON:
            exec(compile(command[1], "<program>", "exec"), {"__name__": "__main__"})
            code = 0
        elif command[0] == PHASEWIRE:
            sys.argv = command
            runpy.run_module("phasewire", run_name="__main__")
            code = 0
        else:
            code = NOT_STARTED
            os.execvp(command[0], command)
    except SystemExit as left:
        code = left.code if isinstance(left.code, int) else int(left.code is not None)
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def _wait(line: BinaryIO, request: dict[str, Any], child: int, outputs: tuple[IO[bytes], IO[bytes]]) -> None:
    """Answer when a command has ended; end it if it takes too long."""
    timers = [
        threading.Timer(seconds, _end, (child, number))
        for seconds, number in (
            (request["seconds"], signal.SIGINT),
            (request["seconds"] + GRACE_SECONDS, signal.SIGKILL),
        )
    ]
    for timer in timers:
        timer.start()
    _, status = os.waitpid(child, 0)
    for timer in timers:
        timer.cancel()
    texts = []
    for file in outputs:
        file.seek(0)
        texts.append(file.read(MOST_OUTPUT_BYTES).decode(errors="replace"))
        file.close()
    out, err = texts
    _say(line, {"id": request["id"], "code": os.waitstatus_to_exitcode(status), "out": out, "err": err})


def _end(child: int, number: int) -> None:
    with suppress(ProcessLookupError):
        os.killpg(child, number)


def _say(line: BinaryIO, answer: dict[str, Any]) -> None:
    data = json.dumps(answer).encode() + b"\n"
    with lock:
        while data:
            data = data[line.write(data) :]  # the port takes 32 KiB at a time


if __name__ == "__main__":
    main(sys.argv[1])
