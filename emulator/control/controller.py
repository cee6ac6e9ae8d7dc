"""The USB controller: takes blocks and requests from its doors and hands each to the part that it concerns.

A block goes through `Admission`, which judges it, `Execution`, which carries it out, and `Dispatch`, which plans its
change and lets it go along the `Chain`; when the change takes effect the `StateMachine` is told. Updates that come
together take the path of `Batches`, requests that of `Requests`, and faults that of `KnownFaults`. What the device
knows of itself is its `DeviceState`. The controller itself puts these parts together, counts and answers blocks, and
is what the doors and the `Emulator` see; it knows no packets and no lines: whoever carries blocks is a `Door`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from ...base.errors import BlockError
from ...protocol.blocks import Block, Clock, Update, unpack
from ...protocol.board import CHANNELS, TICKS_PER_PERIOD
from ...protocol.chain import Identity
from ...protocol.codes import AckFlag, Fault, Reason, State
from ...protocol.console import TEST_WIDTH_TICKS
from ...protocol.pulses import Pulses
from ...protocol.replies import Ack, Info, Status
from ...protocol.requests import Setup
from ...protocol.timing import SORT_CYCLES
from ..door import Door
from ..ports.clock import Timebase
from ..scheduler import Scheduler
from .admission import Admission
from .batches import Batches
from .chain import Chain
from .device_state import DeviceState
from .dispatch import Dispatch
from .execution import Execution
from .known_faults import KnownFaults
from .requests import Identification, Requests
from .state_machine import StateMachine

__all__ = ["Controller"]

NO_FLAGS = AckFlag(0)


class Controller:
    """The device behind its doors.

    Parameters
    ----------
    scheduler : Scheduler
        The clock of the machine.
    time : Timebase
        The device's periods.
    chain : Chain
        The way to the processors.
    identities : sequence of Identity
        What the processors answered when they were numbered.
    identification : Identification
    log : callable
        What takes a line about each thing that happens.
    restart : callable
        What starts the device anew, as at power-up.
    revert : callable
        What does the same, and goes back to the factory image on the way.
    confirm : callable
        What is told once that the firmware has come up (clause FWU-020).
    faults : Fault
        Faults that are known from the beginning.
    """

    def __init__(
        self,
        scheduler: Scheduler,
        time: Timebase,
        chain: Chain,
        identities: Sequence[Identity],
        identification: Identification,
        *,
        log: Callable[[str], None],
        restart: Callable[[], None],
        revert: Callable[[], None],
        confirm: Callable[[], None],
        faults: Fault,
    ) -> None:
        self.time = time
        self._tracer = chain.tracer
        self._log = log
        self._confirm = confirm
        self._confirmed = False
        wiring = identification.wiring
        device = self._device = DeviceState()
        dispatch = self._dispatch = Dispatch(
            scheduler, time, chain, device, log=log, on_wake=lambda: self._execution.end_sequence()
        )
        machine = self._machine = StateMachine(device, dispatch, log=log, status=self.status)
        self._faults = KnownFaults(device, dispatch, machine, identities, identification.bank, log=log)
        self._requests = Requests(
            device, dispatch, machine, self._faults, identification, restart=restart, revert=revert, log=log
        )
        self._admission = Admission(device, dispatch)
        self._execution = Execution(device, dispatch, machine, wiring)
        self._batches = Batches(device, dispatch, machine, self._execution, wiring)
        if found := faults | self._faults.supervisor.found:
            self.raise_fault(found, "found at start")

    def attach(self, door: Door) -> None:
        """From now on send unsolicited records to a door."""
        self._machine.attach(door)

    # Time

    @property
    def now_tick(self) -> int:
        """Ticks since period 0."""
        return self._dispatch.now_tick

    @property
    def tail_period(self) -> int:
        """The period at which the last change that was accepted takes effect."""
        return self._dispatch.agenda.tail.period

    @property
    def state(self) -> State:
        """The state of the device."""
        self.settle()
        return self._device.state

    def settle(self) -> None:
        """Let everything that is planned up to now have taken effect."""
        self._dispatch.settle()

    def unfold(self) -> None:
        """From now on let every message travel: something may go wrong, or somebody looks on."""
        self.settle()
        self._machine.unfold()
        if self._dispatch.chain.folded:
            self._dispatch.unfold()
            self._faults.supervisor.unfold()

    # Blocks

    @property
    def can_accept(self) -> bool:
        """Whether there is room for another block; the OUT endpoint answers NAK otherwise (clause BLK-009)."""
        return self._dispatch.has_room

    def await_room(self, waiter: Callable[[], None]) -> None:
        """Call somebody once, as soon as there is room for another block."""
        self._dispatch.await_room(waiter)

    def accept(self, packet: bytes, door: Door, arrived: int | None = None) -> None:
        """Judge a block and give its acknowledgement to the door that it came by.

        Parameters
        ----------
        packet : bytes
            The bytes of the block, of any number.
        door : Door
        arrived : int, optional
            Tick at which its last byte had arrived; now by default.
        """
        dispatch = self._dispatch
        dispatch.settle()
        if arrived is None:
            arrived = dispatch.now_tick
        try:
            block = unpack(packet)
            self._admission.judge(block, arrived // TICKS_PER_PERIOD)
        except BlockError as error:
            sequence = int.from_bytes(packet[4:8], "little")
            self._refuse(error, f"block {sequence}")
            door.acknowledge(self._ack(arrived, self._device.last_refusal, sequence).encode())
            return
        gap = self._device.count(block)
        change = self._execution.carry_out(block.body, door)
        self._tracer.span(dispatch.now, dispatch.now + SORT_CYCLES, "controller", "sort")
        dispatch.trace_queue()
        flags, commit_period = (AckFlag.GAP if gap else NO_FLAGS), 0
        if change is not None:
            commit_period = change.period
            if change.late:
                flags |= AckFlag.LATE
                self._device.late += 1
        elif isinstance(block.body, Clock):
            commit_period = self._requests.clock().sync_period
        door.acknowledge(self._ack(arrived, Reason.ACCEPTED, block.sequence, commit_period, flags).encode())

    def _ack(
        self,
        arrived: int,
        reason: Reason,
        sequence: int,
        commit_period: int = 0,
        flags: AckFlag = NO_FLAGS,
    ) -> Ack:
        return Ack(reason, sequence, commit_period, arrived, flags, self._dispatch.free, self._device.state)

    def _refuse(self, error: BlockError, what: str) -> None:
        self._device.refused += 1
        self._device.last_refusal = Reason(error.reason)
        self._log(f"refuses {what}: {error}")

    def take(self, packets: NDArray[np.uint8], began: int, deadline: int, door: Door) -> tuple[int, int]:
        """Accept updates that arrive back to back over USB, as far as nothing else comes between.

        See `Batches.take`.
        """
        return self._batches.take(packets, began, deadline, door)

    def test_transducer(self, transducer: int, door: Door) -> None:
        """Drive one transducer alone, weakly, if there is room for it (clause CON-008).

        Raises
        ------
        BlockError
            If an update would be refused.
        """
        self.settle()
        width = np.zeros(CHANNELS, np.uint8)
        width[transducer] = TEST_WIDTH_TICKS
        update = Update(Pulses(np.zeros(CHANNELS, np.uint8), width))
        try:
            self._admission.judge(Block(update, 0, restart=True), self._dispatch.period)
        except BlockError as error:
            self._refuse(error, f"a test of transducer {transducer}")
            raise
        self._execution.carry_out(update, door)

    def drop_frames(self, count: int) -> None:
        """Count frames that were damaged on a line and dropped."""
        self._device.dropped_frames += count

    # Requests

    def request(self, setup: Setup, data: bytes, door: Door) -> bytes:
        """Carry out a vendor request that came by a door (chapter REQ).

        Raises
        ------
        Stall
            If the device does not know the request, or not in this state.
        """
        return self._requests.request(setup, data, door)

    def info(self) -> Info:
        """Answer the INFO request."""
        return self._requests.info()

    def status(self) -> Status:
        """What the device is doing (clause REQ-003)."""
        return self._requests.status()

    @property
    def blinking(self) -> list[int]:
        """Boards whose light blinks now (clause REQ-012)."""
        return self._requests.blinking

    # The bus, and what goes wrong

    def host_arrived(self) -> None:
        """A host configured the device, or something was answered on a serial line: the firmware has come up."""
        if not self._confirmed and self._faults.supervisor.complete:
            self._confirmed = True
            self._confirm()

    def new_session(self, door: Door) -> None:
        """The bus was reset, or the host (re)configured the device (clauses USB-003 and NUM-004)."""
        self._machine.new_session(door)

    def suspend(self) -> None:
        """The bus that had configured the device is suspended."""
        self._machine.suspend()

    def resume(self) -> None:
        """The bus resumes, or is gone for good."""
        self._machine.resume()

    def detach(self, door: Door) -> bool:
        """The device is asked through a door to detach; whether it does, in its state."""
        return self._machine.detach(door)

    @property
    def faults(self) -> Fault:
        """The faults that the device knows of."""
        return self._device.faults

    def raise_fault(self, fault: Fault, what: str) -> None:
        """Something is wrong (clause SAF-008)."""
        self._faults.appear(fault, what)
