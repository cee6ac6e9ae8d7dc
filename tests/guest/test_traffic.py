"""Traffic that the kernel's usbmon recorded is explained without a fault, and in causal order."""

from __future__ import annotations

import base64
import io
import json
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from phasewire.__main__ import main
from phasewire.hil.conformance.guest import Guest

from .conftest import Bench

pytestmark = pytest.mark.guest

FRAMES = 30


def test_a_recorded_stream_is_valid_and_each_acknowledgement_follows_its_block(
    bench: Bench, guest: Guest, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    width = np.repeat(np.arange(1, FRAMES + 1, dtype=np.uint8)[:, None] % 20, 320, axis=1)
    file = io.BytesIO()
    np.savez(file, width=width, phase=width % 2)
    frames = guest.share("frames.npz", file.getvalue())
    bench.check("modprobe", "usbmon")
    recording = guest.start("tcpdump", "-i", "usbmon0", "-w", "/tmp/traffic.pcap", "-U", seconds=120)
    bench.check("sh", "-c", "until [ -s /tmp/traffic.pcap ]; do sleep 0.1; done")
    bench.attach()
    bench.check("phasewire", "watchdog", "5", "--device", "usb:")
    bench.check("phasewire", "stream", frames, "--rate", "1000", "--device", "usb:")
    bench.check("phasewire", "info", "--device", "usb:")
    guest.signal(recording)
    assert guest.wait(recording).code == 0
    capture = tmp_path / "traffic.pcap"
    capture.write_bytes(base64.b64decode(bench.check("base64", "/tmp/traffic.pcap")))
    with pytest.raises(SystemExit) as ended:
        main(("decode", str(capture), "--json", "-"))
    assert not ended.value.code
    told = json.loads(capsys.readouterr().out)
    assert told["invalid"] == 0
    assert all(before["time_s"] <= after["time_s"] for before, after in pairwise(told["pieces"]))
    sent: list[int] = []
    for piece in told["pieces"]:
        if piece["kind"] == "block":
            sent.append(piece["fields"]["sequence"])
        elif piece["kind"] == "acknowledgement":
            assert piece["fields"]["sequence"] == sent.pop(0), "it is for the oldest block that waits"
    assert sent == []
    assert told["kinds"]["block"] == told["kinds"]["acknowledgement"] > FRAMES
