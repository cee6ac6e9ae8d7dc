"""The program ``phasewire``: it installs signal handlers, and only then loads the command line."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from signal import SIGINT

from .base.signals import SIGNALLED, loading, unwinding

__all__ = ["main"]


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line and exit.

    Parameters
    ----------
    arguments : sequence of str, optional
        The words after the program's name; None for those with which the program was started.
    """
    try:
        with unwinding(last=arguments is None):
            with loading():
                from .cli.commands import run
            run(sys.argv[1:] if arguments is None else arguments)
    except KeyboardInterrupt:  # also a signal that came before its handler was installed
        sys.exit(SIGNALLED + SIGINT)


if __name__ == "__main__":
    main()
