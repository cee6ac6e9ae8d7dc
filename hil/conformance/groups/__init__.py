"""The cases, a file for each group. They speak to the device by the bench alone.

pytest imports these files by their path, so they name the package in full.
"""

from __future__ import annotations
