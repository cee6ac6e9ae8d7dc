"""The faults that the device knows of: how they appear, what follows from them, and how they are cleared.

It alone changes the faults of the device, and it owns the `Supervisor`, by which it learns of those of the processors.
Faults that somebody injects are not its matter (see `emulator.faults`): it meets only their outcome.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from ...protocol.chain import Identity
from ...protocol.codes import CLEARED_BELOW_C, SILENCING_FAULTS, Bank, Fault
from ...protocol.replies import ENABLED
from ...protocol.states import StateEvent
from .device_state import DeviceState
from .dispatch import STOP_MODULATION, Dispatch
from .state_machine import StateMachine
from .supervisor import BROKEN, Supervisor

__all__ = ["KnownFaults"]


class KnownFaults:
    """Raises faults and clears them."""

    def __init__(
        self,
        device: DeviceState,
        dispatch: Dispatch,
        machine: StateMachine,
        identities: Sequence[Identity],
        bank: Bank,
        *,
        log: Callable[[str], None],
    ) -> None:
        self._device = device
        self._dispatch = dispatch
        self._machine = machine
        self._log = log
        self.supervisor = Supervisor(
            dispatch.scheduler,
            dispatch.time,
            dispatch.chain,
            dispatch,
            identities,
            bank,
            on_fault=self.appear,
            on_miss=self._heed_miss,
        )
        dispatch.chain.stuck = self._lose_chain

    def appear(self, fault: Fault, what: str) -> None:
        """Something is wrong (clause SAF-008)."""
        self._dispatch.settle()
        device = self._device
        new = fault & ~device.faults
        if not new:
            return
        device.faults |= fault
        self._log(f"fault {new.name}: {what}")
        was = device.state
        if new & SILENCING_FAULTS:
            self._machine.happen(StateEvent.FAULT, self._dispatch.now)
        if device.state is was:
            self._machine.send_status()

    def clear(self) -> None:
        """Clear all that does not persist (clause REQ-011)."""
        supervisor, device = self.supervisor, self._device
        kept = device.faults & (Fault.SYNC | Fault.FLASH)
        if self._dispatch.chain.broken:
            kept |= device.faults & Fault.CHAIN
        if not supervisor.all_answer:
            kept |= device.faults & Fault.PROCESSOR
        if supervisor.temperature_c >= CLEARED_BELOW_C:
            kept |= device.faults & Fault.TEMPERATURE
        if supervisor.persists(Fault.SUPPLY):
            kept |= device.faults & Fault.SUPPLY
        cleared, device.faults = device.faults & ~kept, kept
        supervisor.forget(cleared)
        if not kept & SILENCING_FAULTS:
            self._machine.happen(StateEvent.CLEAR, self._dispatch.now)
        if cleared:
            self._machine.send_status()

    def _heed_miss(self, processor: int) -> None:
        """A processor missed a commit: if that commit may have been the silence, send the silence again.

        If the processor misses that too, it falls silent by itself, because it is asked nothing until then (clause
        CHN-018). In both cases it is silent until the outputs are enabled.
        """
        self._dispatch.settle()
        if self._device.state not in ENABLED and self.supervisor.leave_alone(processor):
            self._log(f"processor {processor} may have missed the silence: sends it again, and leaves it alone")
            self._dispatch.send_silence((STOP_MODULATION,))

    def _lose_chain(self) -> None:
        """A message cannot leave: nothing is sent any more, stores that wait included."""
        self._dispatch.loading.drop()
        self.appear(BROKEN, "a message cannot leave: the chain is broken")
        self._dispatch.announce_room()
