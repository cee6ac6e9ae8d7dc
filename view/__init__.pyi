"""The public names of this room. ``__init__.py`` reads this file too."""

from .snapshot import Emitter as Emitter
from .snapshot import Snapshot as Snapshot
from .view import View as View
