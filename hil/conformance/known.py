"""Known failures: cases that a device's makers expect to fail, each with a reason, in TOML.

Each table has the name of a case, in quotes, and a reason::

    ["blocks/a-flipped-bit-is-refused"]
    reason = "the checksum is not checked before revision C"
"""

from __future__ import annotations

import re

from ...base.storage import FilePath
from .tables import read_table

__all__ = ["read_known_failures"]

REASON = "reason"
_CASE = re.compile(r"[^/\s]+/\S.*")


def read_known_failures(path: FilePath) -> dict[str, str]:
    """Cases that are expected to fail, and why.

    Raises `InputFileError` if the file is no TOML, or an entry names no case or has no reason; it says which, and what
    would be right, and `OSError` if the file cannot be read.
    """
    whole = read_table(path)
    reasons = {}
    for case in whole.values:
        if _CASE.fullmatch(case) is None:
            raise whole.error(case, 'it names no case; a table begins as in ["blocks/a-flipped-bit-is-refused"]')
        entry = whole.table(case)
        entry.check_keys([REASON])
        reasons[case] = entry.text(REASON)
    return reasons
