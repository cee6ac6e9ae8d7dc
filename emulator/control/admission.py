"""Admission: whether the device accepts a block in the state that it is in, by the order of clause ACK-003.

`judge_numbers` is the rule for numbers, periods and drive. Blocks that come one by one are judged by it here, and the
same function, compiled, judges updates that come together (`batch_kernels`). This module reads what the device knows
and what is stored; it changes neither, and it counts and answers nothing.
"""

from __future__ import annotations

from ...base.errors import BlockError
from ...protocol.blocks import AmplitudeModulation, Block, Body, Entries, Output, PlaySequence, Samples, Slot, Update
from ...protocol.codes import HORIZON_PERIODS, SILENCING_FAULTS, Reason
from ...protocol.numbering import follows
from ...protocol.replies import ENABLED
from .device_state import DeviceState
from .dispatch import Dispatch

__all__ = ["CHANGES", "Admission", "judge_numbers"]

CHANGES = (Update, PlaySequence, AmplitudeModulation, Output)
STORED = (Slot, Entries, Samples)


class Admission:
    """Judges blocks."""

    def __init__(self, device: DeviceState, dispatch: Dispatch) -> None:
        self._device = device
        self._dispatch = dispatch

    def judge(self, block: Block, arrived: int) -> None:
        """Raise `BlockError` if the block, which arrived in period `arrived`, cannot be carried out."""
        self._judge_state(block.body)
        self._judge_numbers(block, arrived)
        self._judge_stores(block.body)

    def _judge_state(self, body: Body) -> None:
        device = self._device
        if isinstance(body, CHANGES + STORED) and device.faults & SILENCING_FAULTS:
            raise BlockError(f"{device.faults.name} is not cleared", Reason.FAULT)
        if isinstance(body, CHANGES) and device.state not in ENABLED:
            raise BlockError(Reason.DISABLED.text, Reason.DISABLED)

    def _judge_numbers(self, block: Block, arrived: int) -> None:
        """Judge a block by its number, its period and its drive."""
        body, sequence, restart = block
        device, last = self._device, self._device.last_sequence
        named = device.last_named if isinstance(body, Update) else None
        requested = body.period if isinstance(body, CHANGES) else 0
        drive = body.pulses.total_drive if isinstance(body, Update | Slot) else 0
        reason = judge_numbers(
            restart or last is None or follows(sequence, last),
            requested,
            arrived + HORIZON_PERIODS,
            -1 if named is None else named,
            self._dispatch.periods_per_update,
            drive,
            1000 * device.drive_limit,
        )
        if reason:
            values: dict[Reason, dict[str, object]] = {
                Reason.SEQUENCE: {"sequence": sequence, "last": last},
                Reason.HORIZON: {"period": requested, "arrived": arrived},
                Reason.RATE: {"period": requested, "named": named, "least": self._dispatch.periods_per_update},
                Reason.DRIVE: {"drive": drive / 1000, "limit": device.drive_limit},
            }
            raise BlockError(reason.with_values(**values[reason]), reason)

    def _judge_stores(self, body: Body) -> None:
        """Judge a block by what is stored, and by what of it is in use."""
        dispatch = self._dispatch
        if isinstance(body, PlaySequence):
            dispatch.stores.check_power(body, 1000 * self._device.drive_limit)
        if isinstance(body, PlaySequence | AmplitudeModulation):
            dispatch.stores.check_there(body)
        if isinstance(body, STORED):
            dispatch.stores.check_free(body, dispatch.period)


def judge_numbers(
    in_order: bool, requested: int, furthest: int, named: int, least_distance: int, drive: int, limit: int
) -> Reason:
    """Judge a block by its numbers.

    Parameters
    ----------
    in_order : bool
        Whether its sequence number follows the last one, or need not.
    requested : int
        The period that it names; 0 for none.
    furthest : int
        The last period that it may name.
    named : int
        The period that the update before it has named; -1 for none.
    least_distance : int
        Periods from one update to the next, at least.
    drive, limit : int
        Its total drive and the most that it may be, in thousandths of a transducer's (clause SAF-006).

    Returns
    -------
    Reason
        `ACCEPTED`, `SEQUENCE`, `HORIZON`, `RATE` or `DRIVE`.
    """
    if not in_order:
        return Reason.SEQUENCE
    if requested > furthest:
        return Reason.HORIZON
    if requested and named >= 0 and 0 < requested - named < least_distance:
        return Reason.RATE
    if drive > limit:
        return Reason.DRIVE
    return Reason.ACCEPTED
