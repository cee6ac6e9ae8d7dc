"""Batches: the path for many updates that arrive back to back, with the same outcome as one by one.

Compiled kernels (`batch_kernels`) judge, plan and sort them up to the next thing that happens, by the same rules as
`Admission` and `Agenda`. Only updates come this way, and only while nothing else is planned, stored or played; whatever
is not quite regular is left for the path for one block. It may make no difference that can be observed.
"""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import NDArray

from ...protocol.board import CYCLES_PER_PERIOD, CYCLES_PER_TICK, PROCESSORS
from ...protocol.chain import SLICE_BYTES
from ...protocol.codes import HEADER_BYTES, HORIZON_PERIODS, AckFlag, State
from ...protocol.pulses import POWER
from ...protocol.replies import encode_acks
from ...protocol.timing import PACKET_CYCLES, SORT_CYCLES
from ...protocol.updates import unpack_updates
from ...protocol.wiring import Wiring
from ..door import Door
from .agenda import QUEUE_BLOCKS, UpdateBatch
from .device_state import DeviceState
from .dispatch import Dispatch
from .execution import Execution
from .planning import Progress, Rules, is_late
from .state_machine import WATCHED, StateMachine

__all__ = ["Batches"]


class Batches:
    """Takes updates together."""

    def __init__(
        self, device: DeviceState, dispatch: Dispatch, machine: StateMachine, execution: Execution, wiring: Wiring
    ) -> None:
        self._device = device
        self._dispatch = dispatch
        self._machine = machine
        self._execution = execution
        self._transducers = np.argsort(wiring.channels)

    def take(self, packets: NDArray[np.uint8], began: int, deadline: int, door: Door) -> tuple[int, int]:
        """Accept updates that arrive back to back over USB, as far as nothing else comes between.

        Parameters
        ----------
        packets : (k, 512) uint8
            Whole blocks.
        began : int
            Core cycle at which the first of them began to arrive.
        deadline : int
            Core cycle by which the last must have arrived.
        door : Door
            What takes the acknowledgements.

        Returns
        -------
        taken : int
            How many were taken; each exactly as `accept` would have. The next one may be no update, be refused, or have
            to wait for something.
        ended : int
            Core cycle at which the last of them had arrived; time may have passed further.
        """
        dispatch = self._dispatch
        taken = 0
        while taken < len(packets):
            dispatch.settle()
            if not self._is_regular or dispatch.agenda.room_at > deadline:
                break
            more, began = self._take_until_event(packets[taken:], began, deadline, door)
            taken += more
            upcoming = dispatch.scheduler.next_time()
            arrival = max(began + PACKET_CYCLES, dispatch.agenda.room_at)
            if taken == len(packets) or upcoming is None or upcoming > min(arrival, deadline):
                break
            dispatch.scheduler.run_until(upcoming)
        return taken, began

    @property
    def _is_regular(self) -> bool:
        """Whether the next update can be judged and planned like the one before."""
        dispatch, device = self._dispatch, self._device
        quiet = dispatch.chain.folded and not dispatch.loading and device.runs is None and dispatch.agenda.only_updates
        return quiet and device.state in WATCHED and device.last_sequence is not None

    def _take_until_event(self, packets: NDArray[np.uint8], began: int, deadline: int, door: Door) -> tuple[int, int]:
        """The same, but no further than to the next thing that happens."""
        from .batch_kernels import plan_updates, sort_pulses

        dispatch, device = self._dispatch, self._device
        upcoming = dispatch.scheduler.next_time()
        end = deadline if upcoming is None else min(deadline, upcoming - 1)
        most = QUEUE_BLOCKS + max(end - began, 0) // CYCLES_PER_PERIOD + 1  # more do not find room by then
        packets = packets[:most]
        updates, tail, cost = unpack_updates(packets), dispatch.agenda.tail, dispatch.agenda.update_cost
        rules = Rules(
            origin=dispatch.time.origin,
            packet=PACKET_CYCLES,
            sort=SORT_CYCLES,
            end=end,
            limit=1000 * device.drive_limit,
            periods_per_update=dispatch.periods_per_update,
            horizon=HORIZON_PERIODS,
            **cost._asdict(),
        )
        assert device.last_sequence is not None  # else they are not regular
        named = -1 if device.last_named is None else device.last_named
        before = Progress(began, device.last_sequence, named, tail.sent, tail.period, tail.table)
        planned = np.empty((5, len(packets)), np.int64)
        sequences, requested = updates.sequence.astype(np.int64), np.minimum(updates.period, 2**62).astype(np.int64)
        taken, after = plan_updates(
            reasons=updates.reason,
            restarts=updates.restart,
            sequences=sequences,
            requested=requested,
            widths=updates.width,
            power=POWER,
            recent=dispatch.agenda.recent,
            rules=tuple(rules),
            progress=tuple(before),
            planned=planned,
        )
        if not taken:
            return 0, began
        arrivals, starts, periods, gaps, free = planned[:, :taken]
        packed = np.empty((taken, PROCESSORS * SLICE_BYTES), np.uint8)
        sort_pulses(packets[:taken, HEADER_BYTES:], self._transducers, packed)
        begin = partial(self._execution.begin_update, door)
        dispatch.agenda.add_batch(UpdateBatch(starts, periods, packed, cost, tail, begin))
        dispatch.plan_to_wake()
        dispatch.stores.end(int(periods[0]), sequences=True, modulations=False)
        late = is_late(requested[:taken], periods)
        self._acknowledge(door, sequences[:taken], arrivals, periods, late, gaps, free)
        progress = Progress(*after)
        device.last_sequence, device.last_named = progress.number, None if progress.named < 0 else progress.named
        device.accepted += taken
        device.late += int(late.sum())
        device.lost += int(gaps.sum())
        dispatch.scheduler.run_until(int(arrivals[-1]))
        self._machine.watchdog.feed()
        return taken, dispatch.now

    def _acknowledge(
        self,
        door: Door,
        sequences: NDArray[np.int64],
        arrivals: NDArray[np.int64],
        periods: NDArray[np.int64],
        late: NDArray[np.bool_],
        gaps: NDArray[np.int64],
        free: NDArray[np.int64],
    ) -> None:
        dispatch, device = self._dispatch, self._device
        first_effect = dispatch.time.boundary(dispatch.agenda.first_period)
        playing = (arrivals >= first_effect) | (device.state is State.PLAYING)
        flags = np.where(late, AckFlag.LATE, 0) | np.where(gaps > 0, AckFlag.GAP, 0)
        ticks = (arrivals - dispatch.time.origin) // CYCLES_PER_TICK
        states = np.where(playing, State.PLAYING, State.READY)
        for record in encode_acks(sequences, periods, ticks, flags, free, states):
            door.acknowledge(record)
