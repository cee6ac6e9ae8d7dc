"""What lets faults begin and end."""

from __future__ import annotations

from functools import partial

from ...protocol.board import CYCLES_PER_PERIOD
from .fault import FaultTarget, InjectedFault, Lasting

__all__ = ["Injector"]


class Injector:
    """Lets faults begin and end in time, and brings them about again whenever the boards start anew."""

    def __init__(self, device: FaultTarget) -> None:
        self._device = device
        self._standing: list[InjectedFault] = []
        """Those of the boards that are there."""

    def inject(self, fault: InjectedFault) -> None:
        """Let a fault begin at its period."""
        device = self._device
        if fault.period is None:
            self._begin(fault)
            return
        time = device.running.time
        begins = time.boundary(fault.period)
        if begins < device.scheduler.now:
            raise ValueError(f"{fault}: period {fault.period} is over; this is {time.period(device.scheduler.now)}")
        device.scheduler.at(begins, partial(self._begin, fault))

    def afflict(self) -> None:
        """The boards have just got power: bring about what is wrong with them."""
        for fault in self._standing:
            fault.begin(self._device)

    def _begin(self, fault: InjectedFault) -> None:
        device = self._device
        device.log("fault", f"{fault}, begins")
        if fault.on_boards:
            self._standing.append(fault)
        if fault.unfolds:
            device.unfold()
        if device.processors or not fault.on_boards:
            fault.begin(device)
        if isinstance(fault, Lasting) and fault.periods is not None:
            ends = device.scheduler.now + fault.periods * CYCLES_PER_PERIOD
            device.scheduler.at(ends, partial(self._end, fault))

    def _end(self, fault: InjectedFault) -> None:
        device = self._device
        device.log("fault", f"{fault}, ends")
        if fault.on_boards:
            self._standing.remove(fault)
        if device.processors or not fault.on_boards:
            fault.end(device)
            for other in self._standing:
                if type(other) is type(fault):
                    other.begin(device)  # it may concern the same thing
