"""Levers and captures that another package plugs in, against a device without levers of its own."""

from __future__ import annotations

import re
import socketserver
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from importlib.metadata import EntryPoint
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from numpy.typing import NDArray
from phasewire import Emulator
from phasewire.base.errors import DeviceNotFoundError
from phasewire.base.plugins import entries
from phasewire.hil.conformance import Run, Verdict
from phasewire.hil.conformance.cases import Need, Risk
from phasewire.hil.conformance.levers import GROUP, Levers, open_levers
from phasewire.hil.conformance.running import RunOptions, run_conformance
from phasewire.host.transports.opening import SCHEMES

from tests.host.serving import Served

pytestmark = pytest.mark.slow  # each is a run of the suite

GUIDE = Path(__file__).parents[3] / "docs" / "how-to/conformance.md"
RESET = frozenset({Risk.RESET})
POWER = ("power/everything-begins-anew-with-a-restart[power]", "power/what-the-device-is-stays-over-a-restart[power]")
SEEN = "pulses/pulses-are-packed-as-the-specification-shows"
GROUPS = ("power", "pulses")


@pytest.fixture
def served() -> Iterator[Served]:
    with Served(pty=False, baud=3_000_000, history_periods=400_000) as server:
        yield server


@pytest.fixture
def url(served: Served) -> str:
    return f"socket://{served.where}?baud=3000000"


class Analyser(ModuleType):
    """The library of an analyser with probes at two outputs, which takes 24 million samples a second."""

    def __init__(self, served: Served) -> None:
        super().__init__("my_analyser")
        self._served = served
        self.started: list[str] = []

    def start(self, where: str) -> None:
        self.started.append(where)

    def stop(self) -> NDArray[np.uint8]:
        capture = self._served.in_its_thread(self._served.emulator.capture)
        words = capture.bits(capture.start_tick, capture.end_tick)
        levels = (words[:, 5] >> 7 & 1) | (words[:, 0] & 1) << 1
        return np.repeat(levels.astype(np.uint8), 12)[5:, np.newaxis]


@pytest.fixture
def supply(served: Served) -> Iterator[str]:
    """The address of a supply that switches the device's power, by the two commands that it knows."""

    class Supply(socketserver.BaseRequestHandler):
        def handle(self) -> None:
            while command := self.request.recv(100):
                emulator = served.emulator
                known: dict[bytes, Callable[[], None]] = {
                    b"OUTP OFF;*OPC?\n": emulator.power_down,
                    b"OUTP ON;*OPC?\n": emulator.power_up,
                }
                served.in_its_thread(known[command])
                self.request.sendall(b"1\n")

    with socketserver.TCPServer(("127.0.0.1", 0), Supply) as server:
        thread = threading.Thread(target=server.serve_forever, args=(0.05,))
        thread.start()
        yield f"127.0.0.1:{server.server_address[1]}"
        server.shutdown()
        thread.join()


@pytest.fixture
def bench(served: Served, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """The package that the guide shows, installed as any other one."""
    guide = GUIDE.read_text(encoding="utf-8")
    (module,) = re.findall(r"```python\n(\"\"\"my_bench.*?)```", guide, re.DOTALL)
    (tables,) = re.findall(r"```toml\n(\[project.entry-points.*?)```", guide, re.DOTALL)
    (tmp_path / "my_bench.py").write_text(module, encoding="utf-8")
    package = tmp_path / "my_bench-1.dist-info"
    package.mkdir()
    (package / "METADATA").write_text("Metadata-Version: 2.1\nName: my-bench\nVersion: 1\n")
    (package / "entry_points.txt").write_text(re.sub(r'project\.entry-points\.|"', "", tables))
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setitem(sys.modules, "my_analyser", Analyser(served))
    entries.cache_clear()
    yield
    entries.cache_clear()
    sys.modules.pop("my_bench", None)


def verdicts(run: Run) -> dict[str, tuple[Verdict, str]]:
    return {result.case: (result.verdict, result.reason) for result in run.results}


def test_cases_without_their_levers_are_inconclusive(url: str) -> None:
    run = run_conformance(RunOptions(url, allowed=RESET, only=POWER, groups=GROUPS))
    reason = "needs power that can be cut: pass --levers command:power=…"
    assert verdicts(run) == dict.fromkeys(POWER, (Verdict.INCONCLUSIVE, reason))


def test_levers_of_another_package_let_cases_be_judged(bench: None, supply: str, url: str) -> None:
    run = run_conformance(RunOptions(url, levers=(f"scpi:{supply}",), allowed=RESET, only=POWER, groups=GROUPS))
    assert verdicts(run) == dict.fromkeys(POWER, (Verdict.PASS, ""))


def test_a_capture_of_another_package_lets_outputs_be_judged(bench: None, url: str) -> None:
    run = run_conformance(RunOptions(url, capture="mine:0", only=(SEEN,), groups=GROUPS))
    assert run.provenance.capture == "mine:0"
    assert verdicts(run) == {SEEN: (Verdict.PASS, "")}
    assert any("2 of 320 seen in periods" in piece.text for piece in run.results[0].evidence)
    assert sys.modules["my_analyser"].started == ["0"]


SWITCH = """
import sys
from contextlib import ExitStack
from importlib.metadata import EntryPoint
from pathlib import Path
Path("switched.txt").open("a").write(" ".join(sys.argv[1:]) + "\\n")
print("the hub is not there", file=sys.stderr)
sys.exit(sys.argv[2] == "down")
"""


def test_a_program_switches_power_and_cable(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("switch.py").write_text(SWITCH)
    with ExitStack() as stack:
        program = f"{sys.executable} switch.py"
        levers = open_levers([f"command:power={program} 'port 2' {{}}", f"command:cable={program} 7 {{1|0}}"], stack)
        assert levers.can == {Need.POWER, Need.PLUG}
        for switch in (levers.power_down, levers.power_up, levers.unplug, levers.plug):
            switch()
    assert Path("switched.txt").read_text() == "port 2 off\nport 2 on\n7 0\n7 1\n"


@pytest.mark.parametrize(
    ("command", "said"),
    [
        (f"{sys.executable} switch.py 1 {{up|down}}", "` ended with code 1: the hub is not there"),
        ("no-such-program {}", "`no-such-program off` cannot be run: .*No such file"),
    ],
)
def test_a_lever_that_fails_tells_its_output_and_leaves_the_case_inconclusive(
    url: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: str, said: str
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("switch.py").write_text(SWITCH)
    run = run_conformance(
        RunOptions(url, levers=(f"command:power={command}",), allowed=RESET, only=POWER, groups=GROUPS)
    )
    assert [result.verdict for result in run.results] == [Verdict.INCONCLUSIVE] * 2
    for result in run.results:
        assert re.search(f"^the lever 'command:power=.*' failed: .*{said}", result.reason)


def test_a_device_that_a_lever_left_without_power_is_not_to_blame(monkeypatch: pytest.MonkeyPatch) -> None:
    """The lever switches off and not on again, and the cases after that cannot be judged."""

    class Broken(Levers):
        def __init__(self, _rest: str) -> None:
            pass

        def power_down(self) -> None:
            emulator.power_down()

        def power_up(self) -> None:
            raise ConnectionError("the supply is gone")

    monkeypatch.setitem(entries(GROUP), "broken", cast("EntryPoint", SimpleNamespace(value="", load=lambda: Broken)))
    with Emulator() as emulator:
        run = run_conformance(RunOptions(emulator.url, "none", ("broken:",), RESET, only=POWER, groups=GROUPS))
    assert {result.verdict for result in run.results} == {Verdict.INCONCLUSIVE}
    assert "the lever 'broken:' failed: the supply is gone" in run.results[0].reason
    assert "the device cannot be brought back" in run.results[-1].reason


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        ({"levers": ("hub:1",)}, "'hub:1' is not known in phasewire.levers; .* one of command:, emulator:, scpi:$"),
        ({"levers": ("hub",)}, "'hub' is not known in phasewire.levers"),
        ({"levers": ("command:light=lamp {}",)}, "must have the form command:power=PROGRAM … {}"),
        ({"levers": ("command:power=lamp",)}, "must have the form command:power=PROGRAM … {}"),
        ({"levers": ("emulator",)}, "is not emulated in this process"),
        ({"levers": ("emulator:NO-SUCH",)}, "emulator:NO-SUCH goes with a device that is emulated in this process"),
        ({"capture": "scope"}, "'scope' is not known in phasewire.capture; .* one of emulator:, mine:, sigrok:$"),
        ({"capture": "sigrok:"}, "'sigrok:' names no file"),
        ({"capture": "sigrok:."}, r"sigrok:\. is a folder"),
    ],
)
def test_unusable_levers_and_captures_are_refused(
    bench: None, url: str, options: dict[str, Any], complaint: str
) -> None:
    with pytest.raises(ValueError, match=complaint):
        run_conformance(RunOptions(url, **options))


@pytest.mark.parametrize(
    ("device", "complaint"),
    [
        (
            "tee:log:usb:",
            "must also send what is wrong, which a transport cannot.* there are emulator:, .*, usb:, usbip:$",
        ),
        ("nonsense", "^no device at 'nonsense': the URL of a device begins with one of emulator:, .*, usbip:$"),
        ("COM3", "; for this serial port write serial:COM3$"),
    ],
)
def test_a_device_without_a_raw_line_is_refused_and_the_error_says_why(
    device: str, complaint: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(entries(SCHEMES), "tee", entries(SCHEMES)["usb"])  # a transport of another package
    with pytest.raises(DeviceNotFoundError, match=complaint):
        run_conformance(RunOptions(device))


@pytest.mark.parametrize(
    ("lever", "door", "case", "complaint"),
    [
        ("power", "", POWER[0], "is still on the bus"),
        ("power", "?door=serial", POWER[0], "kept its time: it was not without power"),
        ("cable", "", "power/an-unplugged-device-is-found-reset", "is still on the bus"),
    ],
)
def test_a_lever_without_effect_is_blamed_and_not_the_device(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, lever: str, door: str, case: str, complaint: str
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("switch.py").write_text(SWITCH)
    text = f"command:{lever}={sys.executable} switch.py 1 {{}}"
    with Emulator() as emulator:
        run = run_conformance(RunOptions(emulator.url + door, "none", (text,), RESET, only=(case,), groups=GROUPS))
    (result,) = run.results
    assert result.verdict is Verdict.INCONCLUSIVE
    assert result.reason.startswith(f"the lever '{text}' reported success, but the device {complaint}")
    assert run.provenance.levers == (text,)
    told = [piece.text for piece in result.evidence if piece.label == "lever"]
    assert [re.sub("`.*`", "it", each) for each in told] == [
        f"{action}: it ended with code 0: the hub is not there"
        for action in {"power": ("power_down", "power_up"), "cable": ("unplug", "plug")}[lever]
    ]
