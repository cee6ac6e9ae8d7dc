"""A Linux kernel of its own that meets the emulator, as a judge that none of us wrote.

This room fetches Debian's kernel, starts it in QEMU without any hardware, and runs programs in it. The guest sees this
computer's files, which it cannot change, so that its programs and the project's environment are those of the computer.
Its network leads to one place only: a USB/IP server on this computer.
"""

from __future__ import annotations

from .kernel import NEWEST, Kernel, fetch_kernel, missing_programs
from .machine import BOUND, SERVER, Done, Guest, GuestError

__all__ = ["BOUND", "NEWEST", "SERVER", "Done", "Guest", "GuestError", "Kernel", "fetch_kernel", "missing_programs"]
