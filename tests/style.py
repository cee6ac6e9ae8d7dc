"""Finds phrases in code and documents that docs/style.md rules out: a line for each, and exit code 1 if any.

Only patterns are here that a search can tell from right uses. SPEC.md keeps its words, because firmware is written
against them.
"""

import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

LEFT_OUT = ("docs/style.md", "protocol/SPEC.md", "tests/style.py")
SUGGESTIONS = {
    r"\b(None|[Ee]mpty|[Ii]nconclusive|refused|[Ff]ails?|[Rr]aises? `\w+`|only for) where\b": "if",
    r"^\s*(\"\"\"|# )?Where (there|nothing|none|something|somebody) [^,]*, ": "If …,",
    r", where it (is|are|has|have|does|do|can)\b": "if",
    r"^\s+Where (it|they|the file) (is damaged|are|cannot|do|does)\b": "If …",
    r"\bwhere need be\b": "if necessary",
    r"\b[Ff]rom when on\b": "the period from which …",
    r"\b[Bb]ehind (SILENCE|DISABLE|ENABLE|RESET|2³²)": "after",
    r"\b([Bb]ehind|[Rr]ight behind) (a|the|its|each|every) (last repeat|refusal|time|reset|restart|gap)\b": "after",
    r"\bone behind the other\b": "one after the other",
    r"\b(has|have) not the\b": "lacks the",
    r"\bare not some of\b": "state what they are",
    r"\b(hold|holds|holding|keep|keeps)( it)? (up|back) none\b|\bholds? back is none\b": "holds nothing back",
    r"\blets? go of (its|the|his)\b": "drops, releases",
    r"(^|[.:;,] |\"\"\"|[Ss]o )[Ww]ho \w+s (a|an|the|it|its)\b": "whoever …, a program that …",
    r", be (it|they) ": "even if, such as",
    r"\bnobody asked for\b": "unsolicited",
    r"\bof (its|their) own accord\b": "unsolicited, by itself",
    r"\bwas told to be\b|\bis said to be\b|\bare said to be\b": "is reported as",
    r"\bso that nobody but\b": "so that only",
    r"\bthat it is none\b|\bwhich is none\b": "that it is not one",
    r"\bdoes otherwise\b|\bdo otherwise\b": "say what it does",
}
CONTINUES = re.compile(
    r"^( +)[\w*, `]+ : .+\n\1    (Of|In|For|Is|By|From|With|To|Where|Which|Whose|Such|At|On|That)\b", re.MULTILINE
)
"""The text of a parameter that continues its name instead of being a sentence of its own."""


def findings() -> Iterator[str]:
    """A line for each phrase: file, line, the words, and what to write instead."""
    listed = subprocess.run(["git", "ls-files", "*.py", "*.md"], capture_output=True, text=True, check=True)
    patterns = [(re.compile(pattern), instead) for pattern, instead in SUGGESTIONS.items()]
    for name in listed.stdout.split():
        if name in LEFT_OUT:
            continue
        text = Path(name).read_text("utf-8")
        for each in CONTINUES.finditer(text):
            yield f"{name}:{text.count(chr(10), 0, each.end()) + 1}: {each[2]!r} continues the name → say what it is"
        for number, line in enumerate(text.splitlines(), 1):
            for pattern, instead in patterns:
                if found := pattern.search(line):
                    yield f"{name}:{number}: {found[0].strip()!r} → {instead}"


if __name__ == "__main__":
    sys.exit("\n".join(findings()) or 0)
