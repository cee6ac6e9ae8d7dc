"""From captured bits to what skin could feel of them."""

from __future__ import annotations

from ...emulator import Capture
from ...feel.perception import FeltMap, feel
from ...feel.skin import Skin
from ...feel.unfolding import SkinPlaces
from ...solver import Medium, TransducerArray
from ..sound.emission import emitted_waves

__all__ = ["felt_from"]


def felt_from(
    capture: Capture,
    places: SkinPlaces,
    first: int,
    last: int,
    array: TransducerArray | None = None,
    medium: Medium | None = None,
    skin: Skin | None = None,
) -> FeltMap:
    """The felt map of some carrier periods of a capture, as if they were repeated.

    Parameters
    ----------
    capture : Capture
        The outputs.
    places : SkinPlaces
        Places of skin, such as `Unfolded.of` a hand; they lie still.
    first, last : int
        Carrier periods of the capture, 25 µs each; last is not included. Whole periods of the modulation have clean
        spectra.
    array : TransducerArray, optional
        320 transducers; by default those of the boards.
    medium : Medium, optional
        The air; 20 °C by default.
    skin : Skin, optional
        The skin of the hand by default.

    Raises
    ------
    ValueError
        As `emitted_waves` and `feel`.
    """
    array = array or TransducerArray.grid()
    return feel(array, emitted_waves(capture, array, first, last).waves, places, medium, skin)
