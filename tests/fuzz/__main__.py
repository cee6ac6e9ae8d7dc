"""Run the fuzzer: ``python -m tests.fuzz 60`` gives each group of decoders so many seconds (that is `make fuzz`).

``python -m tests.fuzz GROUP OPTION...`` fuzzes one group, with options of libFuzzer such as ``-runs=10000``, or tries
the named files. Interesting inputs are kept in build/fuzz/GROUP and tried first the next time; bytes
that broke something are written beside it.
"""

from __future__ import annotations

import re
import resource
import subprocess
import sys
from hashlib import sha256
from pathlib import Path

FOUND = Path("build") / "fuzz"
ROOM_BYTES = 2**30
KERNELS = "phasewire.protocol.kernels"  # numba compiles them as they stand


def fuzz(group: str, options: list[str]) -> None:
    """Fuzz one group; this does not return."""
    import atheris

    with atheris.instrument_imports(include=["phasewire", "construct"], exclude=[KERNELS]):
        from .decoders import GROUPS, seeds

    if group not in GROUPS:
        sys.exit(f"{group!r} is neither a number of seconds, at least 1, nor a group: {', '.join(GROUPS)}")
    corpus = FOUND / group
    corpus.mkdir(parents=True, exist_ok=True)
    for seed in seeds(group):
        (corpus / sha256(seed).hexdigest()[:16]).write_bytes(seed)
    files = [option for option in options if not option.startswith("-")]
    defaults = [f"-artifact_prefix={FOUND / group}-", "-print_final_stats=1"]
    limit_memory()
    atheris.Setup([__file__, *defaults, *options, *([] if files else [str(corpus)])], GROUPS[group])
    atheris.Fuzz()


def limit_memory() -> None:
    """Limit the growth of the address space to `ROOM_BYTES`; libraries and compiled kernels are mapped already."""
    mapped = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (mapped + ROOM_BYTES, resource.RLIM_INFINITY))


def fuzz_all(seconds: int) -> int:
    """Fuzz every group in a process of its own, as libFuzzer needs it; return the exit code."""
    from .decoders import GROUPS

    for group in GROUPS:
        command = [sys.executable, "-m", "tests.fuzz", group, f"-max_total_time={seconds}"]
        ended = subprocess.run(command, stderr=subprocess.PIPE, text=True, errors="replace", check=False)
        if ended.returncode:
            print(ended.stderr[-4000:])
            return ended.returncode
        (runs,) = re.findall(r"^stat::number_of_executed_units: (\d+)", ended.stderr, re.MULTILINE)
        begun, *_, reached = re.findall(r"\bcov: (\d+)", ended.stderr)
        print(f"{group:<12} {int(runs):>9,} runs, {begun} edges at first, {reached} in the end", flush=True)
    return 0


def main() -> None:
    """Fuzz all groups, or one."""
    first, *options = sys.argv[1:] or [""]
    if first.isdecimal() and int(first):  # to libFuzzer 0 means no limit
        sys.exit(fuzz_all(int(first)))
    fuzz(first, options)


main()
