"""The conformance suite in the guest: behind a kernel the device fails no case, and few cannot be judged."""

from __future__ import annotations

import json
import re
from collections import Counter
from pathlib import Path

import pytest
from phasewire.emulator.firmware.loader import DeviceIdentity, make_flash
from phasewire.hil.conformance.cases import Need, Risk, not_allowed, unmet
from phasewire.hil.conformance.verdicts import Verdict
from phasewire.protocol.codes import Target
from phasewire.protocol.firmware import Image, Segment
from phasewire.protocol.versions import Version
from phasewire.protocol.wiring import Wiring

from .conftest import Bench

pytestmark = pytest.mark.guest

SOME = (
    "enumeration/unknown-requests",
    "endpoints/a-console-that-is-not-read",
    "endpoints/set-interface",
    "acknowledgements/more-blocks-than-records",
    "acknowledgements/a-status-has-a-place",
    "flow/a-place-is-free-again",
    "serial/a-console-that-is-not-read",
    "serial/every-line-coding",
)
"""Cases whose transfers are cut short, whose records wait, and that use the console's interfaces."""
GROUPS = (
    ("acknowledgements", "flow", "numbering", "limits", "outputs", "pulses", "sorting", "stores"),
    ("blocks", "chain", "doors", "endpoints", "enumeration", "power", "versions", "widths"),
    ("combinations", "modulation", "sequences", "successions"),
    ("console", "long-run", "robustness"),
    ("dfu",),
    ("flash",),
    ("requests", "states"),
    ("safety", "timing"),
    ("serial",),
)
GROUP_SECONDS = 900.0

NOT_THERE = {unmet(need) for need in Need}
"""Why a case cannot be judged from the other end of a cable."""
NOT_HERE = re.compile(
    "only at full speed can a part of a block arrive"
    "|this computer's system does not send such a request"
    "|the computer configures the device by itself before a program can reset it"
    "|the computer's serial driver sets the line coding before a program can ask for it"
    "|this line has no connection to close"
    "|this applies to (a device that is used over a serial line alone|UARTs)"
)
"""Why it cannot be judged through Linux at high speed."""
TOO_SLOW = re.compile(
    r"the line brought \d+ of \d+ updates too late: it does not carry 40000 a second"
    r"|(in \d+ attempts )?no block came exactly .* periods ahead of its change"
    r"|the device had left before this computer could ask all"
    r"|.*, on a computer with a load of .*: it cannot judge that"
    r"|th(e|is) line (is|was) too slow"
    r"|the host was held up for \d+ ms"
)
"""Why it cannot be judged in a guest without KVM, whose blocks arrive some milliseconds sooner or later."""


SEGMENTS = (Segment(Target.ALL_PROCESSORS, bytes(range(1, 256)) * 21), Segment(Target.CONTROLLER, bytes(6000)))
"""Of firmware that has as many blocks and sectors as that of a real device."""


UNDECIDED = f"""
import json
with open("/tmp/report") as file: results = json.load(file)["results"]
print(json.dumps([each["reason"] for each in results if each["verdict"] == "{Verdict.INCONCLUSIVE}"]))
"""


def judged(bench: Bench, *only: str, allow: tuple[Risk, ...] = (), seconds: float) -> Counter[str]:
    """Run cases, none of which may fail; why others came to no verdict, and how many."""
    names = [word for name in only for word in ("--only", name)]
    risks = [word for risk in allow for word in ("--allow", risk)]
    done = bench.run(
        "phasewire", "conformance", "--device", "usb:", "--json", "/tmp/report", *names, *risks, seconds=seconds
    )
    assert done.code == 0, f"{done.out}\n{done.err}"
    assert [line for line in bench.complaints() if "did not claim" in line] == []
    return Counter(json.loads(bench.python(UNDECIDED)))


def test_what_a_kernel_makes_difficult_passes(bench: Bench) -> None:
    bench.attach()
    reasons = judged(bench, *SOME, seconds=300)
    assert [why for why in reasons if why != not_allowed(Risk.RESET) and not NOT_HERE.match(why)] == []
    assert sum(reasons.values()) < 10
    bench.check("test", "-e", "/dev/ttyACM0")  # the kernel has its console again


@pytest.mark.guest_slow
@pytest.mark.parametrize("groups", GROUPS, ids="+".join)
def test_a_group_passes(bench: Bench, tmp_path: Path, groups: tuple[str, ...]) -> None:
    flash = tmp_path / "flash-of-real-size"
    make_flash(DeviceIdentity("EMU-0001", Wiring.strips()), Image(Version(1, 0, 0), SEGMENTS)).save(flash)
    bench.serve("--flash", str(flash))
    bench.attach("--loop")
    told = judged(bench, *(f"{group}/" for group in groups), allow=tuple(Risk), seconds=GROUP_SECONDS)
    reasons = [why for why in told if why not in NOT_THERE]
    assert [why for why in reasons if not (NOT_HERE.match(why) or TOO_SLOW.match(why))] == []
