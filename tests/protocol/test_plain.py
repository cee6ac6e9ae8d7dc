from __future__ import annotations

from phasewire.protocol.plain import plain
from phasewire.protocol.pulses import Pulses


def test_pulses_can_have_another_form_at_any_depth() -> None:
    assert plain({"all": [Pulses.silent(320)]}, pulses=len) == {"all": [320]}
