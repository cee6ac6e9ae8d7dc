"""The public names of this room. ``__init__.py`` reads this file too."""

from .exposure import LIMITS as LIMITS
from .exposure import Exposure as Exposure
from .exposure import exposure_at as exposure_at
from .exposure import exposure_limit as exposure_limit
from .exposure import seated as seated
from .hearing import Audible as Audible
from .hearing import a_weighting as a_weighting
from .hearing import audible as audible
from .perception import FeltMap as FeltMap
from .perception import feel as feel
from .perception import felt_map as felt_map
from .perception import radiation_pressures as radiation_pressures
from .power import RadiatedPower as RadiatedPower
from .power import radiated_power as radiated_power
from .power import warming as warming
from .receptors import TOUCH_CHANNELS as TOUCH_CHANNELS
from .skin import Skin as Skin
from .unfolding import SkinPatch as SkinPatch
from .unfolding import SkinPlaces as SkinPlaces
from .unfolding import Unfolded as Unfolded
