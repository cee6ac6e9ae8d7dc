"""Break the chain processors' program in one way at a time, and see whether the conformance suite notices.

The bugs are changes of the sources in `firmware/xmos/processor` (`processors.toml`, in the form of `texts`). The
program is built with each, and executed by all ten processors of an emulated device, which the cases that should catch
it judge. If an entry names no case, the build itself must refuse the program. The program without a bug must pass all
these cases. A bug in C needs clang with the target xcore::

    python -m phasewire.hil.conformance.mutants.processors             # all; exit code 1 if one gets away
    python -m phasewire.hil.conformance.mutants.processors NAME ...    # some of them
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from tempfile import TemporaryDirectory

from ....base.errors import InputFileError
from ....firmware.xmos import build
from ....firmware.xmos.images import CONTROLLER_STAND_IN
from ....firmware.xs1.assembler import AssemblySource
from ....firmware.xs1.clang import find_clang
from ....protocol.codes import Target
from ....protocol.firmware import Image, Segment
from ....protocol.firmware import build as build_file
from ....protocol.versions import Version
from ..running import RunOptions
from .texts import WORKERS, TextMutant, TextOutcome, judge_all, read_text_mutants, run_cases

__all__ = ["broken_image", "broken_sources", "judge_processors", "known_mutants", "needs_clang"]

WARM = "phasewire.hil.conformance.mutants.warm_processors"
BUGS = Path(__file__).with_suffix(".toml")
UNBROKEN = TextMutant("unbroken", "Nothing.", "start.s", (), (), "", {})


def known_mutants() -> list[TextMutant]:
    """All of them, in the order of their file."""
    return list(read_text_mutants(BUGS))


def needs_clang(mutant: TextMutant) -> bool:
    """Whether its program cannot be built without a clang: the bug is not in assembly."""
    return not mutant.file.endswith(".s")


def broken_sources(mutant: TextMutant, folder: Path) -> list[AssemblySource]:
    """The sources of the program with a bug, as assembly.

    Parameters
    ----------
    mutant : TextMutant
    folder : Path
        An empty one, for sources in C.

    Raises
    ------
    ValueError
        If the bug does not fit its file any more.
    InputFileError
        If the source does not compile with it.
    """
    text = mutant.broken((build.FOLDER / mutant.file).read_text("utf-8"))
    made = [AssemblySource(mutant.file, text)]
    if needs_clang(mutant):
        for path in build.FOLDER.glob("*.[ch]"):
            (folder / path.name).write_bytes(path.read_bytes())
        (folder / mutant.file).write_text(text, "utf-8")
        made = [each.compiled() for each in build.c_files(folder) if each.stale]
    by_name = {source.name: source for source in made}
    return [by_name.get(source.name, source) for source in build.kept_sources()]


def broken_image(sources: Sequence[AssemblySource]) -> Image:
    """The image of a device whose processors execute a program.

    Parameters
    ----------
    sources : sequence of AssemblySource
        The program, as `broken_sources` makes it.

    Raises
    ------
    BuildError, InputFileError
        If the build refuses the program.
    """
    segments = (
        Segment(Target.ALL_PROCESSORS, build.stored(build.program_of(sources))),
        Segment(Target.CONTROLLER, CONTROLLER_STAND_IN),
    )
    return Image(Version(*build.FIRST_VERSION), segments)


def _judge(mutant: TextMutant) -> TextOutcome:
    """Build it, and run its cases; those of the unbroken program must pass."""
    with TemporaryDirectory() as folder:
        try:
            sources = broken_sources(mutant, Path(folder))
        except ValueError as error:
            return TextOutcome(False, str(error))
        try:
            image = broken_image(sources)
        except (build.BuildError, InputFileError) as error:
            return TextOutcome(not mutant.only, f"the build: {error}")
        file = Path(folder) / "image.dfu"
        file.write_bytes(build_file(image))
        unbroken = mutant.name == UNBROKEN.name
        return run_cases(RunOptions(f"emulator:?firmware={file}"), mutant, passes=unbroken, warm=WARM)


def judge_processors(names: Sequence[str]) -> int:
    """Judge mutants, all by default, and the program without a bug; the exit code."""
    known = known_mutants()
    if find_clang() is None:
        sys.stdout.write("no clang with the target xcore: only bugs in assembly are judged\n")
        known = [mutant for mutant in known if not needs_clang(mutant)]
    chosen = [mutant for mutant in known if not names or mutant.name in names]
    cases = sorted({case for mutant in chosen for case in ([mutant.case] if mutant.case else mutant.only)})
    with ThreadPoolExecutor(WORKERS) as pool:
        unbroken = list(pool.map(_judge, [UNBROKEN._replace(only=(case,)) for case in cases]))
    wrong = [outcome.words for outcome in unbroken if not outcome.right]
    sys.stdout.write(f"unbroken: {', '.join(wrong) or 'PASS'}\n")
    sys.stdout.flush()
    return max(1 if wrong else 0, judge_all(names, known, _judge))


if __name__ == "__main__":
    sys.exit(judge_processors(sys.argv[1:]))
