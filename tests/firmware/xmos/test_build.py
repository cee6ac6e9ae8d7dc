"""The kept image is what the sources make; budgets and versions are checked."""

from __future__ import annotations

from pathlib import Path

import pytest
from phasewire.firmware.xmos import build, kept
from phasewire.firmware.xmos.build import (
    FIRST_VERSION,
    BuildError,
    budget,
    build_processor,
    c_files,
    compiled_with,
    load_processor,
    processor_segment,
    stale,
)
from phasewire.firmware.xs1.assembler import AssemblySource
from phasewire.firmware.xs1.clang import CompilerMissingError, find_clang
from phasewire.firmware.xs1.program import MEMORY_BYTES, RAM_BASE

RUN_AGAIN = "run `python -m phasewire.firmware.xmos.build`"


def test_the_kept_assembly_is_not_older_than_the_c() -> None:
    assert stale() == [], RUN_AGAIN


def test_the_kept_image_is_what_the_kept_sources_make() -> None:
    """Bit for bit, with its map."""
    made = build_processor(compile=False)
    loaded = load_processor()
    assert made.image == loaded.image, RUN_AGAIN
    assert made.map_text() == build.MAP.read_text(encoding="utf-8"), RUN_AGAIN
    assert dict(made.symbols) == dict(loaded.symbols)


def test_a_rebuilt_image_is_the_kept_one() -> None:
    """From the C, where there is the clang that made the kept assembly."""
    if find_clang() is None:
        pytest.skip("no clang with the target xcore is installed")
    if compiled_with() not in c_files()[0].compiled().text:
        pytest.skip(f"the kept assembly was made by {compiled_with()}, which is another clang than the installed one")
    assert build_processor(compile=True).image == load_processor().image, RUN_AGAIN


def test_the_program_begins_where_it_is_loaded_and_fits() -> None:
    program = load_processor()
    assert program.base == program.symbols["start"] == RAM_BASE
    found = budget(program)
    assert found.bytes == program.end - program.base <= MEMORY_BYTES
    assert {stack.thread for stack in found.stacks} == {"port", "receive", "play", "handle"}
    assert all(stack.needs <= stack.has for stack in found.stacks)
    assert found.threads == 4
    sizes = {part.name: part.bytes for part in found.memory}
    assert (sizes["slots"], sizes["entries"], sizes["samples"]) == (12288, 4096, 4096)
    assert all(size > 0 for size in sizes.values())
    assert f"of {MEMORY_BYTES}" in found.text()


def test_a_segment_has_its_version_and_no_zeros_at_its_end() -> None:
    first, other = processor_segment(FIRST_VERSION), processor_segment((7, 8, 9))
    at = load_processor().symbols["firmware_version"] - RAM_BASE
    assert first[at : at + 3] == bytes(FIRST_VERSION)
    assert other == first[:at] + bytes((7, 8, 9)) + first[at + 3 :]
    assert first == build.IMAGE.read_bytes()
    assert len(first) < 16_384


@pytest.mark.parametrize("version", [(1, 2, 256), (-1, 0, 0), (1, 2)])
def test_a_version_has_three_bytes(version: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match="0 to 255"):
        processor_segment(version)  # type: ignore[arg-type]


@pytest.fixture
def copied(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Sources that may be changed."""
    folder = tmp_path / "processor"
    (folder / "generated").mkdir(parents=True)
    for path in (*build.FOLDER.glob("*.[sch]"), *build.GENERATED.glob("*.s")):
        (folder / path.relative_to(build.FOLDER)).write_bytes(path.read_bytes())
    monkeypatch.setattr(build, "FOLDER", folder)
    monkeypatch.setattr(build, "GENERATED", folder / "generated")
    return folder


@pytest.mark.parametrize(("name", "old"), [("play.c", ["play.c"]), ("processor.h", ["play.c", "tables.c", "handle.c"])])
def test_a_change_of_the_c_is_noticed(copied: Path, name: str, old: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    path = copied / name
    path.write_text(path.read_text(encoding="utf-8") + "\n/* changed */\n", encoding="utf-8")
    assert stale() == old
    with pytest.raises(BuildError, match=f"{old[0]}.* is older than the C"):
        build_processor(compile=False)
    monkeypatch.setattr(kept, "find_clang", lambda: None)
    with pytest.raises(CompilerMissingError, match=f"{old[0]} cannot be made, because no clang"):
        build_processor()


@pytest.mark.parametrize(
    ("before", "after", "message"),
    [
        (".set PLAY_STACK, 64", ".set PLAY_STACK, 8", "thread play needs .* words of stack and has 8"),
        ("    bl begin_thread\n    bl handle\n", 3 * "    bl begin_thread\n" + "    bl handle\n", "starts 6 threads"),
    ],
)
def test_what_does_not_fit_is_refused(copied: Path, before: str, after: str, message: str) -> None:
    path = copied / "start.s"
    text = path.read_text(encoding="utf-8")
    assert before in text
    path.write_text(text.replace(before, after), encoding="utf-8")
    with pytest.raises(BuildError, match=message):
        build_processor(compile=False)


@pytest.mark.parametrize(
    ("code", "message"),
    [
        ("    bl f", "calls itself"),
        ("    bla r4", "calls by an address .* call the function by its name"),
        ("    bl g", "g is called, and no source has it"),
    ],
)
def test_a_stack_without_a_limit_is_refused(code: str, message: str) -> None:
    function = "    .cc_top {0}.function,{0}\n{0}:\n    entsp 2\n{1}\n    retsp 2\n    .cc_bottom {0}.function\n"
    threads = "".join(function.format(name, "    bl f") for name in ("start", "port", "receive", "play", "handle"))
    source = AssemblySource("t.s", threads + function.format("f", code))
    with pytest.raises(BuildError, match=message):
        budget(load_processor(), [source])
