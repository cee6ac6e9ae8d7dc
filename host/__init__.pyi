"""The public names and their modules. ``__init__.py`` reads this file too."""

from .hands import HandFrame as HandFrame
from .hands import HandSource as HandSource
from .hands import PlacedHands as PlacedHands
from .hands import Pose as Pose
from .hands import TrackedHand as TrackedHand
from .hands import open_hands as open_hands
from .streaming.asynchronous import AsyncDevice as AsyncDevice
from .streaming.asynchronous import open_device_async as open_device_async
from .streaming.calibration import Calibration as Calibration
from .streaming.device import Device as Device
from .streaming.device import open_device as open_device
from .streaming.envelopes import Envelope as Envelope
from .streaming.envelopes import parse_envelope as parse_envelope
from .streaming.envelopes import read_envelope as read_envelope
from .streaming.envelopes import sine as sine
from .streaming.frames import Frame as Frame
from .streaming.frames import Frames as Frames
from .streaming.frames import FrameSource as FrameSource
from .streaming.frames import solved as solved
from .streaming.group import DeviceGroup as DeviceGroup
from .streaming.group import open_devices as open_devices
from .streaming.recording import Recording as Recording
from .streaming.recording import record as record
from .streaming.rig import RigDevice as RigDevice
from .streaming.rig import read_rig as read_rig
from .streaming.streaming import StreamReport as StreamReport
from .transports.transport import Found as Found
from .transports.transport import Scheme as Scheme
from .transports.transport import Timekeeper as Timekeeper
from .transports.transport import Transport as Transport

__all__: list[str]
