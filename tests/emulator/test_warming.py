"""A served device has its kernels before a host waits."""

from __future__ import annotations

from typing import Any

import pytest
from phasewire.emulator.control import batch_kernels
from phasewire.emulator.doors.warming import load_kernels


def test_all_kernels_of_batches_are_called(monkeypatch: pytest.MonkeyPatch) -> None:
    called = []
    for name in batch_kernels.__all__:
        kernel = getattr(batch_kernels, name)

        def noted(*arguments: Any, _name: str = name, _kernel: Any = kernel, **named: Any) -> Any:
            called.append(_name)
            return _kernel(*arguments, **named)

        monkeypatch.setattr(batch_kernels, name, noted)
    load_kernels()
    assert set(called) == set(batch_kernels.__all__)
