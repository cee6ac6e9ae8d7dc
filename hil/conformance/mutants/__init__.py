"""Broken emulators. They show the worth of the conformance suite, which must catch every one.

Each file is named after what is broken in it. `patching` says how a mutant is made, `catalogue` lists all, `running`
runs the suite against each in its own process, and `reports` prints the results. The wheel leaves this package out.
"""

from __future__ import annotations
