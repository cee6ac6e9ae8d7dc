"""Runs written by hand: a result of every standing, and texts that no report may take for more than texts."""

from __future__ import annotations

from dataclasses import replace

from phasewire.hil.conformance.clauses import Clause
from phasewire.hil.conformance.matrix import Chapter, ClauseRows, Level, Matrix, MatrixRow
from phasewire.hil.conformance.verdicts import Evidence, Provenance, Result, Run, Verdict

__all__ = ["CLEAN", "DECISIVE", "EVERY", "HOSTILE", "MATRIX", "PROVENANCE"]

HOSTILE = "<script>alert(1)</script> & \"quoted\" 'text' ]]> \x00\x07\x1b[31m\x9b\ud800\ufffe [red] Ωµ"
"""A possible name of a device; all of it is legible but seven controls and halves of characters."""

PROVENANCE = Provenance(
    suite="0.1.0",
    specification="1 (0123456789abcdef)",
    device={"url": "emulator:", "name": "Array <b>", "unique id": "A&B", "firmware": "1.2.3"},
    began="2026-11-20T16:00:00Z",
    seconds=12.34,
    profile="none",
    capture="none",
    levers=("command:power=relay {}", "scpi:1"),
    allowed=("reset", "drive"),
    seed=7,
    cores=2,
    load=(7.9, 8.1),
)

SEEN = tuple(Evidence(f"step {number}", f"{number:02x} 00") for number in range(1, 11))
DECISIVE = Evidence("records", "50 41 " + 200 * "00 ", "acknowledgement 7 accepted ✗ ACK-002: it is wrong")
CLEANED_UP = Evidence("status at the end", "state OFF", after=True)

EVERY = Run(
    PROVENANCE,
    (
        Result("blocks/good", ("BLK-003",), "A good block is taken.", Verdict.PASS, seconds=0.25),
        Result(
            "blocks/bad[a b]",
            ("BLK-003", "ACK-003/1"),
            "A bad block is refused, for damage must not play.",
            Verdict.FAIL,
            "the state is OFF, should be READY",
            (*SEEN, Evidence("device", HOSTILE), DECISIVE, CLEANED_UP),
            0.5,
            again=Verdict.FAIL,
            fresh=True,
        ),
        Result(
            "blocks/known",
            ("BLK-006/1",),
            "Known to fail.",
            Verdict.FAIL,
            "it did",
            known="revision C",
            again=Verdict.PASS,
        ),
        Result("blocks/healed", ("BLK-006/1",), "Known, but passes.", Verdict.PASS, known="revision B"),
        Result("usb/slow", ("USB-001",), "Should be quick.", Verdict.WARN, "it took 3 s"),
        Result("usb/lines", ("USB-002",), "Lines are seen.", Verdict.INCONCLUSIVE, "needs an analyser: --capture X"),
        Result("usb/more", ("USB-002",), "Lines are seen.", Verdict.INCONCLUSIVE, "needs an analyser: --capture X"),
        Result("usb/cut", ("USB-003",), "Power is cut.", Verdict.INCONCLUSIVE, "needs --allow reset"),
        Result("serial/port", ("SER-001",), "A UART talks.", Verdict.NOT_APPLICABLE, "no UART is fitted"),
    ),
    ("known failure blocks/ghost names no case",),
)
"""Two of nine break, and something is wrong with the run."""

CLEAN = replace(EVERY, results=EVERY.results[:1], trouble=())


def _clause(identifier: str, title: str, *rows: MatrixRow) -> ClauseRows:
    return ClauseRows(Clause(identifier, identifier[:3], title, tuple(row.sentence for row in rows), ()), rows)


MATRIX = Matrix(
    (
        Chapter(
            "BLK",
            "blocks & more",
            (
                _clause(
                    "BLK-003",
                    "blocks & more",
                    MatrixRow("BLK-003", "Damage MUST be refused.", Level.MUST, ("blocks/good", "blocks/bad[a b]")),
                ),
                _clause(
                    "BLK-006",
                    "blocks & more",
                    MatrixRow("BLK-006/1", "It MUST <heal>.", Level.MUST, ("blocks/known", "blocks/healed")),
                    MatrixRow("BLK-006/2", "It MUST not be seen.", Level.MUST, (), "nobody can see it"),
                    MatrixRow("BLK-006/3", "It MUST be forgotten.", Level.MUST, ()),
                    MatrixRow("BLK-006", "It is so.", Level.NONE, ("blocks/left-out",)),
                ),
            ),
        ),
        Chapter(
            "USB",
            "enumeration",
            (
                _clause(
                    "USB-001", "enumeration", MatrixRow("USB-001", "It SHOULD be quick.", Level.SHOULD, ("usb/slow",))
                ),
                _clause(
                    "USB-002", "enumeration", MatrixRow("USB-002", "Lines.", Level.NONE, ("usb/lines", "usb/more"))
                ),
            ),
        ),
    ),
    (),
)
"""The clauses of some cases of `EVERY`, and of one case that did not run."""
