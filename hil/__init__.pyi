"""The public names and their modules. ``__init__.py`` reads this file too."""

from .loop.end_to_end import Check as Check
from .loop.end_to_end import EndToEnd as EndToEnd
from .loop.end_to_end import run_end_to_end as run_end_to_end
from .loop.rig_run import RigRun as RigRun
from .loop.rig_run import run_rig as run_rig
from .loop.sensing import Sensation as Sensation
from .loop.sensing import sense as sense
from .loop.touching import TouchRun as TouchRun
from .loop.touching import run_touch as run_touch
from .sound.air import Playback as Playback
from .sound.emission import EmittedWaves as EmittedWaves
from .sound.emission import emitted_waves as emitted_waves

__all__: list[str]
