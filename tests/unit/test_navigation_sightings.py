"""Openings seen in several pictures: one place, told from noise, and what it says of a junction."""

import math
from typing import Literal

import pytest

from juncnet.camera import CameraGeometry
from juncnet.messages import Capabilities, Mission, Phase, RoadOpening, RoadSeen, Turn
from juncnet_services.junction_navigation.config import NavigatorConfig
from juncnet_services.junction_navigation.detector import JunctionDetector
from juncnet_services.junction_navigation.place import MOUTH_BEFORE_M, mouth_m
from juncnet_services.junction_navigation.plan import BESIDE_M, JunctionPlan
from juncnet_services.junction_navigation.progress import Junction, Place, Progress, Sighting
from juncnet_services.junction_navigation.sightings import Sightings
from surfaces import surface

CAMERA = CameraGeometry()
BAND = CAMERA.band
STEP_M = 0.12


def progress(*turns: Turn) -> Progress:
    mission = Mission(turns=turns, finish_after=5)
    return Progress(flight="f", configured=mission, mission=mission)


def road(*openings: RoadOpening, ends_m: float | None = None) -> RoadSeen:
    return RoadSeen(offset_m=0, heading_rad=0, width_m=6, openings=openings, ends_m=ends_m)


def approach(
    state: Progress,
    opening_m: float,
    travelled_m: float,
    smoothed: float,
    every: int = 1,
    from_m: float = 0.0,
    drift: float = 0.0,
) -> Sightings:
    """Drive towards an opening left at `opening_m` that every `every`-th picture shows.

    `drift`: how much of the way it goes along.
    """
    sightings = Sightings(CAMERA, state)
    state.smoothed = smoothed
    for step in range(round(travelled_m / STEP_M)):
        state.odometer_m = from_m + step * STEP_M
        near_m = opening_m - (1 - drift) * state.odometer_m + 0.2 * math.sin(7.0 * step)
        shown = (RoadOpening(side="left", near_m=near_m),) if step % every == 0 else ()
        sightings.see(road(*shown), state.odometer_m)
        sightings.weigh()
    return sightings


def test_an_opening_seen_for_long_with_some_score_is_a_junction_where_it_is() -> None:
    state = progress()
    found = approach(state, 15.0, 8.0, smoothed=0.7).next_junction()
    assert found is not None
    assert mouth_m(found, BAND, 6.0) == pytest.approx(15.0 - MOUTH_BEFORE_M, abs=0.15)
    assert state.sightings == []


@pytest.mark.parametrize(
    ("travelled_m", "smoothed", "every"),
    [(8.0, 0.05, 1), (8.0, 0.5, 1), (1.5, 0.7, 1), (8.0, 0.7, 3)],
    ids=[
        "the score denies it",
        "the score is not sure",
        "seen too shortly",
        "missed more often than seen",
    ],
)
def test_what_is_not_sure_is_no_junction(travelled_m: float, smoothed: float, every: int) -> None:
    sightings = approach(progress(), 15.0, travelled_m, smoothed, every)
    assert sightings.next_junction() is None


@pytest.mark.parametrize(
    ("depth_m", "hidden", "counted"),
    [(2.0, False, False), (9.0, False, True), (2.0, True, True)],
    ids=["a lay-by", "a road", "who knows"],
)
def test_a_lay_by_is_no_junction(depth_m: float, hidden: bool, counted: bool) -> None:
    """The map shows the opening to the left of a road of 6 m, or nothing beside the road."""
    state = progress()
    sightings = Sightings(CAMERA, state)
    state.smoothed = 0.7
    for step in range(70):
        state.odometer_m = step * STEP_M
        near_m = 15.0 - state.odometer_m

        def mark(x: float, y: float, near_m: float = near_m) -> str:
            if abs(y) <= 3:
                return "#"
            if hidden:
                return " "
            return "#" if near_m <= x <= near_m + 5 and 0 < y <= 3 + depth_m else "."

        seen = RoadOpening(side="left", near_m=near_m, far_m=near_m + 5)
        sightings.see(road(seen), state.odometer_m, surface=surface(mark))
        sightings.weigh()
    assert (sightings.next_junction() is not None) is counted


@pytest.mark.parametrize(
    ("length_m", "rise_m", "fall_m", "counted"),
    [
        (5.0, 0.0, None, True),
        (2.5, 0.0, None, False),
        (5.0, 0.0, 1.0, False),
        (5.0, -9.0, 2.0, False),
    ],
    ids=["both", "a path's opening", "a short rise", "of another place"],
)
def test_an_opening_and_a_risen_score_bear_each_other_out(
    length_m: float, rise_m: float, fall_m: float | None, counted: bool
) -> None:
    """Neither would be believed alone: the mean score is low, and was never certain."""
    state = progress()
    opening_m = BAND.d_far_m + MOUTH_BEFORE_M
    sightings = approach(state, opening_m, 8.0, smoothed=0.35)
    (seen,) = state.sightings
    seen.far_m = seen.near_m + length_m
    assert sightings.next_junction() is None
    state.candidate = Junction(rise_m=rise_m, fall_m=fall_m, probability=0.6)
    assert (sightings.next_junction() is not None) is counted


@pytest.mark.parametrize(("drift", "counted"), [(0.2, True), (0.8, False)])
def test_what_goes_along_with_the_robot_is_no_opening(drift: float, counted: bool) -> None:
    """A bend's edge bends away at the same distance ahead, picture after picture."""
    state = progress()
    sightings = approach(state, 12.0, 8.0, smoothed=0.7, drift=drift)
    (seen,) = state.sightings
    assert seen.frames > 60
    assert seen.drift == pytest.approx(drift, abs=0.05)
    assert (sightings.next_junction() is not None) is counted


@pytest.mark.parametrize(("left_m", "another"), [(12.0, True), (14.0, False)])
def test_an_opening_behind_where_a_junction_was_left_is_anothers(
    left_m: float, another: bool
) -> None:
    state = progress()
    state.left_m = left_m
    sightings = approach(state, 15.0, 8.0, smoothed=0.7)
    assert (sightings.next_junction() is not None) is another


def test_a_score_that_fell_before_the_last_junction_was_left_moves_no_opening() -> None:
    """The junctions are so near that the rise and fall of the second's score counted for nothing:
    it is where its opening is, not as far ahead as while its score is high."""
    state = progress()
    detector = JunctionDetector(NavigatorConfig().detector, BAND, state)
    state.junction, state.high, state.smoothed = Junction(rise_m=-20.0, fall_m=-8.0), True, 0.97
    detector.risen(1.0, "junction")
    detector.watch("junction")
    sightings = approach(state, 15.0, 9.5, smoothed=0.97)
    state.high = False
    detector.fallen(9.3)
    state.junction, state.left_m, state.odometer_m = None, 10.5, 10.5
    assert detector.next_junction() is None
    found = sightings.next_junction()
    assert found is not None
    assert mouth_m(found, BAND, 10.5) == pytest.approx(15.0 - MOUTH_BEFORE_M, abs=0.15)


@pytest.mark.parametrize(("turn", "believed"), [("left", True), ("right", False)])
def test_an_opening_to_turn_into_is_believed_sooner(
    turn: Literal["left", "right"], believed: bool
) -> None:
    state = progress(Turn(at=1, turn=turn))
    state.junction, state.count = Junction(rise_m=0.0), 1
    approach(state, 17.5, 1.6, smoothed=0.9)
    assert len(state.junction.sightings) == believed


@pytest.mark.parametrize("trusted", [True, False])
def test_the_edge_of_a_road_that_is_not_surely_its_own_closes_no_opening(trusted: bool) -> None:
    state = progress(Turn(at=1, turn="left"))
    state.junction, state.count = Junction(rise_m=0.0), 1
    sightings = approach(state, 17.5, 3.0, smoothed=0.9)
    for _ in range(40):
        sightings.see(road(), state.odometer_m, trusted)
    assert len(state.junction.sightings) == (not trusted)


def test_a_counted_junction_takes_over_the_opening_beside_its_mouth() -> None:
    state = progress()
    state.junction = Junction(rise_m=0.0)
    approach(state, 17.5, 6.0, smoothed=0.9)
    (own,) = state.junction.sightings
    assert own.near_m == pytest.approx(17.5, abs=0.15)
    scored_m = BAND.d_far_m
    assert 17.5 - MOUTH_BEFORE_M < 16.0
    assert scored_m < mouth_m(state.junction, BAND, 6.0) < 17.5 - MOUTH_BEFORE_M


def test_an_opening_far_from_the_counted_junction_stays_another() -> None:
    state = progress()
    state.junction = Junction(rise_m=0.0)
    approach(state, 32.0, 6.0, smoothed=0.9, from_m=14.0)
    assert state.junction.sightings == []
    assert len(state.sightings) == 1


def sighting(near_m: float, far_m: float | None = None) -> Sighting:
    return Sighting(
        side="left", near_m=near_m, far_m=far_m, weight=10, frames=20, first_m=0, last_m=5
    )


def plan(state: Progress) -> JunctionPlan:
    made = JunctionPlan(NavigatorConfig(), state)
    made.capabilities = Capabilities(kind="copter", turns_in_place=True)
    return made


@pytest.mark.parametrize(("opening_m", "kept"), [(13.0, True), (8.5, False)])
def test_rise_and_opening_outvote_a_late_fall_but_no_opening_alone(
    opening_m: float, kept: bool
) -> None:
    mouth = 11.0
    junction = Junction(rise_m=mouth - BAND.d_far_m, rise_seen=True, probability=1.0)
    late = 4.6 if kept else 0.0
    junction.fall_m = mouth - BAND.d_near_m + late
    seen = Sighting(
        side="right", near_m=opening_m, far_m=None, weight=40.0, first_m=0.0, last_m=9.0, frames=90
    )
    state = progress()
    state.junction, state.odometer_m, junction.sightings = junction, mouth, [seen]
    Sightings(CAMERA, state).see(road(), mouth)
    assert junction.sightings == ([seen] if kept else [])
    # Kept: where both say, the fall being out. Dropped: where the score rose and fell.
    assert mouth_m(junction, BAND, mouth) == pytest.approx(mouth, abs=0.1)


def test_a_turn_is_made_in_the_middle_of_its_opening() -> None:
    state = progress(Turn(at=1, turn="left"))
    state.count = 1
    state.junction = Junction(rise_m=0.0, rise_seen=False, sightings=[sighting(12.0, 18.0)])
    assert plan(state).start_ahead_m == pytest.approx(15.0)


def test_the_opening_across_says_where_a_turn_of_no_angle_is_made() -> None:
    across = [sighting(12.0, 20.0)]
    state, skewed = progress(Turn(at=1, turn="right")), progress(Turn(at=1, angle_deg=-60))
    for each in (state, skewed):
        each.count, each.junction = 1, Junction(rise_m=0.0, rise_seen=False, sightings=across)
    assert plan(state).start_ahead_m == pytest.approx(16.0)
    guess = plan(skewed)
    assert guess.start_ahead_m == pytest.approx(guess.mouth_ahead_m + guess.reach_m)


def test_a_skewed_road_is_met_before_it_crosses_the_edge() -> None:
    state = progress(Turn(at=1, angle_deg=60))
    state.count = 1
    state.junction = Junction(rise_m=0.0, rise_seen=False, sightings=[sighting(12.0, 20.0)])
    shift_m = (3.0 + BESIDE_M) / math.tan(math.radians(60))
    assert plan(state).start_ahead_m == pytest.approx(16.0 - shift_m)


@pytest.mark.parametrize("angle_deg", [40.0, 120.0])
def test_where_the_robots_road_ends_a_slanted_one_is_met_before_that_end(angle_deg: float) -> None:
    """The opening may be one of two roads of its side: its middle says nothing then."""
    state = progress(Turn(at=1, angle_deg=angle_deg))
    state.count = 1
    end = Place(at_m=21.0, weight=100.0)
    state.junction = Junction(
        rise_m=0.0, rise_seen=False, sightings=[sighting(12.0, 24.0)], end=end
    )
    before_m = 3.0 / math.sin(math.radians(angle_deg))
    assert plan(state).start_ahead_m == pytest.approx(21.0 - before_m)


def test_a_slight_turn_begins_behind_the_corners() -> None:
    state = progress(Turn(at=1, angle_deg=40))
    state.count = 1
    state.junction = Junction(rise_m=0.0, rise_seen=False, sightings=[sighting(12.0, 15.0)])
    ahead = plan(state)
    assert ahead.start_ahead_m == pytest.approx(ahead.mouth_ahead_m + NavigatorConfig().corner_m)


def test_no_turn_begins_behind_the_end_of_the_road() -> None:
    state = progress(Turn(at=1, turn="right"))
    state.count, state.junction, state.phase = 1, Junction(rise_m=0.0), Phase.CROSSING
    before_m = plan(state).start_ahead_m
    sightings = Sightings(CAMERA, state)
    for step in range(40):
        state.odometer_m = step * STEP_M
        sightings.see(road(ends_m=22.0 - state.odometer_m), state.odometer_m)
    expected_m = 22.0 - 3.0 - state.odometer_m
    assert plan(state).start_ahead_m == pytest.approx(expected_m, abs=0.01)
    assert expected_m < before_m - state.odometer_m


@pytest.mark.parametrize(("aside_rad", "known"), [(0.03, True), (-0.03, True), (-0.08, False)])
def test_an_end_seen_while_looking_aside_is_none_of_the_robots_road(
    aside_rad: float, known: bool
) -> None:
    state = progress()
    state.count, state.junction, state.phase = 1, Junction(rise_m=0.0), Phase.CROSSING
    for _ in range(40):
        Sightings(CAMERA, state).see(road(ends_m=9.0), 0.0, aside_rad=aside_rad)
    assert math.isfinite(plan(state).end_ahead_m) is known


@pytest.mark.parametrize(
    ("far_m", "exit_m"),
    [(None, 22.0), (20.0, 22.0), (25.0, 27.0), (30.0, 22.0)],
    ids=["unseen", "as wide as the own road", "wider", "not believed"],
)
def test_a_junction_is_left_behind_the_opening_across(far_m: float | None, exit_m: float) -> None:
    state, config = progress(), NavigatorConfig()
    state.count, state.odometer_m = 1, 15.0
    opening = sighting(12.0, far_m)
    state.junction = Junction(rise_m=0.0, rise_seen=False, sightings=[opening])
    assert plan(state).past_m == pytest.approx(15.0 - exit_m - config.exit_margin_m)


@pytest.mark.parametrize(("finish_after", "margins"), [(None, 1), (2, 1), (1, 2)])
def test_the_last_junction_is_left_later(finish_after: int | None, margins: int) -> None:
    state, config = progress(), NavigatorConfig()
    state.mission = state.mission.model_copy(update={"finish_after": finish_after})
    state.count, state.odometer_m = 1, 15.0
    state.junction = Junction(rise_m=0.0, rise_seen=False, sightings=[sighting(12.0)])
    assert plan(state).past_m == pytest.approx(15.0 - 22.0 - margins * config.exit_margin_m)


@pytest.mark.parametrize(
    ("far_m", "pictures", "exit_m"),
    [(20.0, 20, 22.0), (23.0, 20, 25.0), (23.0, 2, 22.0), (30.0, 20, 22.0)],
    ids=["as wide as the own road", "wider", "seen too shortly", "not believed"],
)
def test_a_junction_is_left_where_an_edge_seen_on_it_begins_anew(
    far_m: float, pictures: int, exit_m: float
) -> None:
    state, config = progress(), NavigatorConfig()
    state.count, state.odometer_m, state.phase = 1, 15.0, Phase.CROSSING
    state.junction = Junction(rise_m=0.0, rise_seen=False, sightings=[sighting(12.0)])
    state.junction.sightings[0].side = "right"
    sightings = Sightings(CAMERA, state)
    for _ in range(pictures):
        sightings.see(road(RoadOpening(side="left", far_m=far_m - 15.0)), state.odometer_m)
    assert plan(state).past_m == pytest.approx(15.0 - exit_m - config.exit_margin_m)
