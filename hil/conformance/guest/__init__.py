"""A Linux kernel of its own that meets the emulator, as an independent judge.

This room fetches Debian's kernel, starts it in QEMU without any hardware, and runs programs in it. The guest has read
access to this computer's files, so its programs and the project's environment are those of the computer. Its network
leads only to a USB/IP server on this computer.
"""

from __future__ import annotations

from .kernel import NEWEST, GuestKernel, fetch_kernel, missing_programs
from .machine import BOUND, SERVER, Done, Guest, GuestError

__all__ = [
    "BOUND",
    "NEWEST",
    "SERVER",
    "Done",
    "Guest",
    "GuestError",
    "GuestKernel",
    "fetch_kernel",
    "missing_programs",
]
