"""The cases, one file for each group. They reach the device through the bench alone.

pytest imports these files by their path, so they name the package in full.
"""

from __future__ import annotations
