"""VCD files, against one written by hand and pyvcd's reader."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from phasewire import Wiring
from phasewire.emulator.ports import excerpt as excerpts
from phasewire.emulator.ports.excerpt import Excerpt
from phasewire.emulator.ports.vcd import write_vcd
from phasewire.emulator.trace import Signal
from vcd.reader import TokenKind, tokenize

from tests.hand_made import HandMade

# IEEE 1364-2005, 18.2: declarations, then at each time the values that change; a tick is 5 times 100 ns.
BY_HAND = """\
$comment
	Outputs and the transducers that they drive:
	b0p0_01 1
	b2p1_07 176
$end
$timescale 100 ns $end
$version phasewire $end
$scope module board0 $end
$scope module processor0 $end
$var wire 1 ! b0p0_01 $end
$upscope $end
$upscope $end
$scope module board2 $end
$scope module processor1 $end
$var wire 1 " b2p1_07 $end
$upscope $end
$upscope $end
$enddefinitions $end
#5
$dumpvars
1!
0"
$end
#15
0!
1"
#25
1!
#30
"""  # transducer 176: board 2 has columns 8 to 11, its upper half begins in row 8; bit 7 turns back to 8, in row 9


def test_a_file_written_by_hand(tmp_path: Path) -> None:
    capture = HandMade.of({1: "0110011", 167: "0001111"})
    write_vcd(tmp_path / "a.vcd", Excerpt.of(capture, [1, 167], (1, 6)))
    assert (tmp_path / "a.vcd").read_text() == BY_HAND.replace("176", str(9 * 20 + 8))


def read(path: Path, names: Iterable[str]) -> tuple[str, dict[str, list[tuple[int, str]]]]:
    """Time scale of a file, and for each name with its scopes the times at which it gets a value."""
    scope: list[str] = []
    by_code: dict[str, str] = {}
    changes: dict[str, list[tuple[int, str]]] = {name: [] for name in names}
    timescale, now = "", -1
    with path.open("rb") as stream:
        for token in tokenize(stream):
            if token.kind is TokenKind.TIMESCALE:
                timescale = str(token.timescale)
            elif token.kind is TokenKind.SCOPE:
                scope.append(token.scope.ident)
            elif token.kind is TokenKind.UPSCOPE:
                scope.pop()
            elif token.kind is TokenKind.VAR:
                by_code[token.var.id_code] = ".".join([*scope, token.var.reference])
            elif token.kind is TokenKind.CHANGE_TIME:
                now = token.time_change
            elif token.kind is TokenKind.CHANGE_SCALAR:
                changes[by_code[token.scalar_change.id_code]].append((now, token.scalar_change.value))
            elif token.kind is TokenKind.CHANGE_VECTOR:
                value = token.vector_change.value
                changes[by_code[token.vector_change.id_code]].append((now, str(value)))
    assert not scope
    assert set(by_code.values()) == set(changes)
    return timescale, changes


def levels(changes: list[tuple[int, str]], times: range) -> str:
    """The value at each of some times."""
    return "".join([value for time, value in changes if time <= now][-1] for now in times)


@given(
    waves=st.integers(1, 40).flatmap(
        lambda length: st.dictionaries(
            st.integers(0, 319), st.text("01", min_size=length, max_size=length), min_size=1, max_size=8
        )
    ),
    chunk=st.integers(1, 20),
    data=st.data(),
)
def test_every_level_is_read_back(
    waves: dict[int, str], chunk: int, data: st.DataObject, tmp_path_factory: pytest.TempPathFactory
) -> None:
    end = len(next(iter(waves.values())))
    start = data.draw(st.integers(0, end - 1))
    stop = data.draw(st.integers(start + 1, end))
    path = tmp_path_factory.getbasetemp() / "levels.vcd"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(excerpts, "CHUNK_TICKS", chunk)
        write_vcd(path, Excerpt.of(HandMade.of(waves), list(waves), (start, stop)))
    names = {
        channel: f"board{channel // 64}.processor{channel // 32 % 2}.b{channel // 64}p{channel // 32 % 2}_{bit:02}"
        for channel, bit in ((channel, channel % 32) for channel in waves)
    }
    timescale, changes = read(path, names.values())
    assert timescale == "100 ns"
    for channel, wave in waves.items():
        assert levels(changes[names[channel]], range(5 * start, 5 * stop, 5)) == wave[start:stop]
    assert path.read_text().endswith(f"#{5 * stop}\n")


def test_signals_keep_their_core_cycles_beside_the_outputs(tmp_path: Path) -> None:
    """A cycle is 25 times 100 ps, and a tick has 200 of them."""
    state = Signal("controller.state", 3, [(-90, 1), (401, 5), (499, 2), (600, 7)])
    busy = Signal("board0.processor0.link_busy", 1, [(450, 1)])
    counter = Signal("board0.processor0.port_counter", 16, [(399, 1), (400, 2)])
    excerpt = Excerpt.of(HandMade.of({0: "0010"}), [0], (2, 3))
    write_vcd(tmp_path / "a.vcd", excerpt, [state, busy, counter])
    output = "board0.processor0.b0p0_00"
    timescale, changes = read(tmp_path / "a.vcd", [output, state.name, busy.name, counter.name])
    assert timescale == "100 ps"
    assert changes == {
        output: [(10_000, "1")],
        state.name: [(10_000, "1"), (10_025, "5"), (12_475, "2")],  # cycle 600 is after the last tick
        busy.name: [(10_000, "x"), (11_250, "1")],
        counter.name: [(10_000, "2")],
    }


def test_a_comment_names_the_transducers(scrambled: Wiring, tmp_path: Path) -> None:
    write_vcd(tmp_path / "a.vcd", Excerpt.of(HandMade.of({0: "01"}, scrambled)))
    with (tmp_path / "a.vcd").open("rb") as stream:
        comment = next(token.comment for token in tokenize(stream) if token.kind is TokenKind.COMMENT)
    named = dict(line.split() for line in comment.splitlines()[1:] if line.strip())
    assert len(named) == 320
    for transducer in range(320):
        board, processor, bit = scrambled.pin(transducer)
        assert named[f"b{board}p{processor}_{bit:02}"] == str(transducer)


@pytest.mark.parametrize(
    ("signals", "message"),
    [
        ([Signal("state", 1, [])], "'state' names no signal"),
        ([Signal("a b.c", 1, [])], "'a b.c' names no signal"),
        ([Signal("a.b", 0, [])], "signal a.b has 0 bits; at least 1"),
        ([Signal("a.b", 2, [(3, 4)])], "signal a.b is 4 at cycle 3; it has 2 bits"),
        ([Signal("a.b", 2, [(3, -1)])], "signal a.b is -1"),
        ([Signal("a.b", 2, [(3, 1), (3, 2)])], "changes at cycle 3 after 3"),
        ([Signal("a.b", 1, []), Signal("a.b", 2, [])], "two signals have one name"),
    ],
)
def test_an_invalid_signal_is_refused(signals: list[Signal], message: str, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=message):
        write_vcd(tmp_path / "a.vcd", Excerpt.of(HandMade.of({0: "01"})), signals)
    assert not list(tmp_path.iterdir())
