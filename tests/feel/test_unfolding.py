from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from phasewire import Hand
from phasewire.feel.unfolding import SkinPatch, SkinPlaces, Unfolded
from phasewire.solver.contact.anatomy import Side

TURNED = Hand.flat((0.01, -0.02, 0.2), curl=(0.3, 0.5, 0.2, 0.6, 0.9)).rotated(35, (1, 2, 3))


def on_grid(places: SkinPlaces) -> NDArray[np.float64]:
    """(k, 2) where the places are on the flat skin, in metres."""
    return np.asarray(np.argwhere(places.mask)[:, ::-1] * places.spacing)


@pytest.mark.parametrize("side", ["left", "right"])
def test_a_flat_hand_keeps_its_distances_when_it_is_laid_out(side: Side) -> None:
    """All but the rolled thumb. The palm's axis runs to the middle of the knuckles, some mrad aside of the fingers'."""
    unfolded = Unfolded.of(Hand.flat(side=side))
    flat = np.flatnonzero(~np.isin(unfolded.quads, (1, 2, 3)))
    real, grid = unfolded.positions[flat], on_grid(unfolded)[flat]
    np.testing.assert_allclose(real[:, :2] - real[0, :2], grid - grid[0], atol=4e-4)
    assert {1, 2, 3} < set(unfolded.quads.tolist()) == set(range(16))


@pytest.mark.parametrize("hand", [TURNED, Hand(TURNED.landmarks * [-1, 1, 1], "left")])
def test_places_lie_within_the_quadrilaterals_and_a_grid_step_apart(hand: Hand) -> None:
    unfolded = Unfolded.of(hand)
    assert 1900 < len(unfolded.positions) < 2100
    corners = hand.quads[unfolded.quads]
    inward = np.cross(np.roll(corners, -1, axis=1) - corners, unfolded.positions[:, None] - corners)
    backs = -unfolded.normals
    assert np.einsum("kci,ki->kc", inward, backs).min() > -1e-9
    assert np.abs(np.einsum("ki,ki->k", backs, unfolded.positions - corners[:, 0])).max() < 1e-9
    same = (np.diff(np.argwhere(unfolded.mask), axis=0) == [0, 1]).all(axis=1) & (np.diff(unfolded.quads) == 0)
    steps = np.linalg.norm(np.diff(unfolded.positions, axis=0), axis=1)[same]
    np.testing.assert_allclose(steps, unfolded.spacing, rtol=0.15)  # bent fingers are slightly sheared
    assert np.median(steps) == pytest.approx(unfolded.spacing, rel=0.01)


def test_the_same_places_of_skin_move_with_the_hand() -> None:
    """A place on a finger stays as far from both ends of its bone."""
    open_one = Unfolded.of(Hand.flat())
    closed = open_one.at(Hand.flat(curl=0.8))
    assert closed.mask is open_one.mask
    tip = np.flatnonzero(open_one.quads == 9)
    for joint in (11, 12):
        before, after = (np.linalg.norm(u.positions[tip] - u.hand.landmarks[joint], axis=1) for u in (open_one, closed))
        np.testing.assert_allclose(before, after, atol=1e-3)
    assert np.linalg.norm(closed.positions[tip] - open_one.positions[tip], axis=1).min() > 0.03


def test_a_patch_is_a_level_grid_that_looks_down() -> None:
    patch = SkinPatch((0.01, 0.02, 0.3), width=0.04, length=0.02, spacing=5e-3)
    assert patch.mask.shape == (5, 9)
    np.testing.assert_allclose(patch.positions.min(axis=0), [-0.01, 0.01, 0.3])
    np.testing.assert_allclose(patch.positions.max(axis=0), [0.03, 0.03, 0.3])
    np.testing.assert_allclose(patch.positions[1] - patch.positions[0], [5e-3, 0, 0], atol=1e-15)
    np.testing.assert_array_equal(patch.normals, [[0, 0, -1]] * 45)
    assert repr(patch) == "SkinPatch(5 × 9 places, 5 mm apart)"


def test_what_cannot_be_laid_out_is_refused() -> None:
    assert repr(Unfolded.of(Hand.flat(), 0.01)).startswith("Unfolded(1")
    with pytest.raises(ValueError, match="spacing of skin"):
        Unfolded.of(Hand.flat(), 0.0)
    with pytest.raises(ValueError, match=r"spacing 0\.0001 m makes .* places of skin; at most 200000"):
        Unfolded.of(Hand.flat(), 1e-4)
    with pytest.raises(ValueError, match=r"spacing 1e-05 m makes 6\.4e\+07 places of skin"):
        SkinPatch(spacing=1e-5)
    with pytest.raises(ValueError, match="width of skin"):
        SkinPatch(width=-1.0)
    with pytest.raises(ValueError, match="centre of skin"):
        SkinPatch((0.0, np.nan, 0.2))
