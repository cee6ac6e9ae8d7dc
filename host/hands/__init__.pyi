"""The public names and their modules. ``__init__.py`` reads this file too."""

from .frames import HandFrame as HandFrame
from .frames import TrackedHand as TrackedHand
from .placing import PlacedHands as PlacedHands
from .pose import Pose as Pose
from .recording import HandRecorder as HandRecorder
from .recording import HandRecording as HandRecording
from .sources import HandSource as HandSource
from .sources import Readiness as Readiness
from .sources import TrackerScheme as TrackerScheme
from .sources import open_hands as open_hands

__all__: list[str]
