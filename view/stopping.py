"""How a page stops a device: at once, and in the thread that may."""

from __future__ import annotations

from threading import Event, Thread

from ..base.errors import DeviceError, DeviceRefusedError
from ..emulator import Emulator
from ..host import Device
from ..protocol.codes import Reason

__all__ = ["Stopper"]


class Stopper:
    """Turns the outputs of a device off when a page says so.

    A thread of its own brings the stop to a device. An emulated device in this process is the playing thread's alone,
    which looks for a stop in each turn (`serve`).
    """

    def __init__(self, device: Device, emulator: Emulator | None) -> None:
        self._device, self._emulated = device, emulator is not None
        self._wanted = Event()
        self._thread: Thread | None = None
        self.count = 0
        """How often a stop was asked for."""

    def stop(self) -> None:
        """Turn the outputs off, and return at once. Any thread may call it."""
        self.count += 1
        if self._emulated:
            self._wanted.set()
        else:
            self._thread = Thread(target=self._turn_off, name="phasewire stop", daemon=True)
            self._thread.start()

    def check(self) -> None:
        """Raise `DeviceRefusedError` if a stop was asked for, even if it reached the device before anything played."""
        if self.count:
            raise DeviceRefusedError(f"{self._device.name} was stopped by its page", Reason.DISABLED)

    def serve(self) -> None:
        """Do what is left to the playing thread, which calls this in each turn.

        `DeviceError` if the device cannot be reached.
        """
        if self._wanted.is_set():
            self._wanted.clear()
            self._device.stop()

    def wait(self) -> None:
        """Wait until the last stop has reached the device."""
        if self._thread is not None:
            self._thread.join()

    def _turn_off(self) -> None:
        try:
            self._device.stop()
        except DeviceError:
            return  # out of reach: its watchdog turns the outputs off, and the playing thread reports it
