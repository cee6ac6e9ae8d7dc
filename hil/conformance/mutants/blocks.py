"""Broken judgement of blocks: what is accepted or refused though it should not be (chapters BLK and ACK)."""

from __future__ import annotations

from typing import Any

from ....emulator.control import controller
from .patching import Patch, mutant


@mutant("BLK-010")
def horizon_is_not_judged(patch: Patch) -> None:
    """Any period is accepted, however far ahead: the comparison was forgotten."""
    patch.replace(controller, "HORIZON_PERIODS", 2**64)


@mutant("REQ-003", "ACK-003")
def last_refusal_is_always_checksum(patch: Patch) -> None:
    """STATUS names CHECKSUM as the last refusal, whatever it was: only that path stores it."""

    def around(original: Any) -> Any:
        def refuse(self: controller.Controller, error: Any, what: str) -> None:
            original(self, error, what)
            reason = self._last_refusal
            self._last_refusal = type(reason).CHECKSUM

        return refuse

    patch.wrap(controller.Controller, "_refuse", around)
