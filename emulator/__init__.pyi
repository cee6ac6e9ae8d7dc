from .cluster import Cluster as Cluster
from .machine import Emulator as Emulator
from .machine import Event as Event
from .ports.capture import Capture as Capture
from .scenario import read_scenario as read_scenario
