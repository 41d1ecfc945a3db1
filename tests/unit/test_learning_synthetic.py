"""Synthetic pictures: the same by seed, and labelled by what can be seen."""

import math

import numpy as np
import pytest

from juncnet.learning.imperfections import Faults, Lens
from juncnet.learning.samples import LABELS
from juncnet.learning.street_plan import ROAD, Area, Front, Street, rectangle
from juncnet.learning.street_view import Eye, StreetView, visible_share
from juncnet.learning.streets import street_samples
from juncnet.learning.synthetic import Variety, world_samples

SEED = 17
EYE = Eye(0.0, 0.0, 1.5, 0.0, 0.05, 0.0, math.radians(70), 160, 120)


def street(mouth_m: float | None) -> Street:
    """Return a plain road, with a road that crosses it at `mouth_m`."""
    plan = Street("open", 0.0, 3.0, mouth_m, 8.0, 120.0)
    plan.areas.append(Area(rectangle(-3, -4, 3, 110), 80, ROAD))
    if mouth_m is not None:
        plan.areas.append(Area(rectangle(-40, mouth_m, 40, mouth_m + 8), 80, 3))
        plan.areas.append(Area(rectangle(-3, mouth_m, 3, mouth_m + 8), 80, 2))
    return plan


def test_a_street_s_ground_lies_where_the_camera_s_geometry_says() -> None:
    _, mask = StreetView(street(None), np.random.default_rng(0)).picture(EYE)
    focal = 80 / math.tan(math.radians(35))
    row = 80
    depression = math.atan((row + 0.5 - 60) / focal) + EYE.pitch_rad
    # How wide 6 m are at the distance of that row, seen along the ray.
    reach = EYE.height_m / math.sin(depression) * math.cos(depression - EYE.pitch_rad)
    expected = 6.0 * focal / reach
    assert abs(int((mask[row] == ROAD).sum()) - expected) <= 2.5
    assert not mask[: int(60 - focal * math.tan(EYE.pitch_rad)) - 1].any()


def test_what_stands_before_a_junction_hides_it() -> None:
    view = StreetView(street(8.0), np.random.default_rng(0))
    open_view = visible_share(view.picture(EYE)[1])
    assert open_view[0] > 0.015
    assert open_view[1] > 0.004
    view.street.fronts.append(Front((-40, 6.0), (40, 6.0), 9.0, 1, 1.0))
    assert visible_share(view.picture(EYE)[1]) == (0.0, 0.0)


def test_streets_are_the_same_by_seed_and_have_both_classes() -> None:
    first, again = street_samples(SEED, 42), street_samples(SEED, 42)
    np.testing.assert_array_equal(first.gray, again.gray)
    np.testing.assert_array_equal(first.label, again.label)
    assert not np.array_equal(first.gray[:6], street_samples(SEED + 1, 6).gray)
    assert {0, 1} <= set(first.label.tolist())
    assert first.mask is not None
    # A picture that is called junction shows junction, one that is called none shows none.
    seen = (first.mask == 2).mean(axis=(1, 2))
    assert seen[first.label == LABELS.index("junction")].min() > 0.004
    assert seen[first.label == LABELS.index("none")].max() < 0.01


def test_worlds_are_the_same_by_seed_and_vary_by_variety() -> None:
    variety = Variety(height_m=(2.5, 2.5))
    samples, again = (world_samples(1_900_100, 12, variety) for _ in range(2))
    np.testing.assert_array_equal(samples.gray, again.gray)
    assert len(samples) == 12
    assert samples.mask is not None
    assert samples.mask.shape == (12, 32, 32)
    assert (samples.mask > 0).any(axis=(1, 2)).mean() > 0.8
    np.testing.assert_array_equal(samples.height_m, 2.5)


def test_a_lens_without_distortion_changes_nothing_and_others_keep_the_centre() -> None:
    picture = np.random.default_rng(0).integers(0, 255, (41, 61), dtype=np.uint8)
    assert Lens(0.0, (61, 41)).bend(picture) is picture
    for k in (-0.2, 0.2):
        bent = Lens(k, (61, 41)).bend(picture)
        assert bent[20, 30] == picture[20, 30]
        assert not np.array_equal(bent, picture)


@pytest.mark.parametrize("faults", [Faults(1.0, 0.0), Faults(0.0, 1.0)])
def test_faults_change_details_and_not_the_mean(faults: Faults) -> None:
    rng = np.random.default_rng(1)
    picture = rng.integers(80, 160, (72, 128), dtype=np.uint8)
    spoilt = faults.add(picture, rng)
    assert not np.array_equal(spoilt, picture)
    assert abs(float(spoilt.mean()) - float(picture.mean())) < 3.0
    assert Faults(0.0, 0.0).add(picture, rng) is picture
