"""Broken emulators, by which the suite shows what it is worth: it must catch every one of them.

The files are named after what is broken; `patching` says how, `catalogue` has them all, `running` runs the suite
against each in a process of its own, and `reports` tells what came of it. The wheel leaves this room out.
"""

from __future__ import annotations
