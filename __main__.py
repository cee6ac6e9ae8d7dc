"""The program ``phasewire``: it takes charge of signals, and only then loads the command line."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from signal import SIGINT

from .signals import SIGNALLED, loading, unwinding

__all__ = ["main"]


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line and exit.

    Parameters
    ----------
    arguments : sequence of str, optional
        What stands after the program's name; None for what it was started with.
    """
    try:
        with unwinding(last=arguments is None):
            with loading():
                from .cli.commands import run
            run(sys.argv[1:] if arguments is None else arguments)
    except KeyboardInterrupt:  # also one that came before anything heeded it
        sys.exit(SIGNALLED + SIGINT)


if __name__ == "__main__":
    main()
