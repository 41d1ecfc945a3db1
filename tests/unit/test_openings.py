"""Mouths of other roads and the road's end, in masks drawn from plain geometry."""

import numpy as np
import pytest
from numpy.typing import NDArray

from juncnet.camera import CameraGeometry
from juncnet_services.road_following.centre_line import CentreLine
from juncnet_services.road_following.ground_view import GroundView
from juncnet_services.road_following.openings import openings, road_end_m

VIEW = GroundView(CameraGeometry(), (48, 80), 18.0, rows=60)
STEP_M = float(VIEW.x_m[1] - VIEW.x_m[0])
LINE = CentreLine(half_width_m=3.0)


def seen_from_above(
    left: tuple[float, float] | None = None,
    right: tuple[float, float] | None = None,
    ends_m: float = 99.0,
) -> NDArray[np.float32]:
    """A straight road 6 m wide, with roads to either side between two distances ahead."""
    x, y = VIEW.x_m[:, None], VIEW.y_m[None, :]
    road = (np.abs(y) <= 3.0) & (x <= ends_m)
    for span, side in ((left, y > 0), (right, y < 0)):
        if span is not None:
            road |= side & (x >= span[0]) & (x <= span[1])
    return road.astype(np.float32)


def test_a_plain_road_has_no_opening_and_no_end() -> None:
    above = seen_from_above()
    assert openings(VIEW, above, LINE) == ()
    assert road_end_m(VIEW, above, 1.0) is None


@pytest.mark.parametrize("side", ["left", "right"])
def test_an_opening_is_found_where_it_is(side: str) -> None:
    span = (8.0, 14.0)
    above = seen_from_above(left=span) if side == "left" else seen_from_above(right=span)
    (found,) = openings(VIEW, above, LINE)
    assert found.side == side
    assert found.near_m == pytest.approx(8.0, abs=STEP_M)
    assert found.far_m == pytest.approx(14.0, abs=STEP_M)


def test_both_sides_are_found_and_a_far_end_out_of_sight_is_none() -> None:
    found = {o.side: o for o in openings(VIEW, seen_from_above((9.0, 99.0), (11.0, 16.0)), LINE)}
    assert found["left"].near_m == pytest.approx(9.0, abs=STEP_M)
    assert found["left"].far_m is None
    assert found["right"].near_m == pytest.approx(11.0, abs=STEP_M)


def test_an_opening_beside_the_robot_has_no_near_end() -> None:
    (found,) = openings(VIEW, seen_from_above(left=(0.0, 10.0)), LINE)
    assert found.near_m is None
    assert found.far_m == pytest.approx(10.0, abs=STEP_M)


def test_a_nick_in_the_edge_is_no_opening() -> None:
    assert openings(VIEW, seen_from_above(left=(9.0, 9.8)), LINE) == ()


def test_a_bend_that_the_line_follows_is_no_opening() -> None:
    line = CentreLine(curvature_1pm=0.03, half_width_m=3.0)
    x = VIEW.x_m
    across = np.abs(VIEW.y_m[None, :] - line.y(x)[:, None])
    bend = (across <= 3.0 * np.hypot(1.0, line.slope(x))[:, None]).astype(np.float32)
    assert openings(VIEW, bend, line) == ()


def test_the_end_of_the_road_before_a_t_is_found() -> None:
    above = seen_from_above(left=(7.0, 13.0), right=(7.0, 13.0), ends_m=13.0)
    assert road_end_m(VIEW, above, 1.0) == pytest.approx(13.0, abs=STEP_M)


def test_a_gap_in_the_road_is_no_end() -> None:
    above = seen_from_above()
    above[(VIEW.x_m > 9) & (VIEW.x_m < 12)] = 0.0
    assert road_end_m(VIEW, above, 1.0) is None
