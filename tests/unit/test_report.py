"""What a report draws of a flight, and how it holds the flight against the truth."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.pyplot import imread

from juncnet.messages import EventKind, JunctionEvent, Pose, SimulatorTruth, Turn, Velocity
from juncnet.simulation.towns import named_world
from juncnet_services.report.aerial import Aerial, aerial
from juncnet_services.report.flight_data import FlightData, Marked
from juncnet_services.report.key_frames import KeyFrame
from juncnet_services.report.plots import latency, overview, path, probability, turns
from juncnet_services.report.verdict import verdict
from scenes import stamp
from surfaces import roads, surface

WORLD = named_world("evening_suburb")


@pytest.fixture(scope="module", name="photo")
def _photo() -> Aerial:
    return aerial(WORLD, 1.0)


def truth(second: float, **changes: Any) -> tuple[float, SimulatorTruth]:
    fields: dict[str, Any] = {
        "at": stamp(second),
        "header": None,
        "pose": Pose(x_m=2 * second, y_m=0.1 * second**2),
        "velocity": Velocity(forward_mps=2.0),
        "road_offset_m": 0.1,
        "off_road_m": 0.0,
        "collided": False,
        "junction_id": None,
        "junctions_passed": 1,
        "path": (3, 5),
        "label": "none",
        "mouth_m": None,
        "real_time_factor": 1.0,
        "simulated_s": second,
    }
    return second, SimulatorTruth(**(fields | changes))


def entered(second: float, place: tuple[float, float] | None = None) -> Marked:
    event = JunctionEvent(
        header=stamp(second),
        flight="flight-1",
        index=0,
        kind=EventKind.ENTERED,
        count=1,
        probability=0.9,
    )
    return Marked(second, event, place)


def a_flight() -> FlightData:
    """Ten seconds with one junction, and nothing yet of where the vehicle was."""
    data = FlightData(duration_s=10.0, events=[entered(5.0, (10.0, 2.0))])
    data.probability = [(0.1 * i, 0.5) for i in range(100)]
    data.phases = [(0.0, "following"), (4.0, "approaching"), (9.0, "finished")]
    data.thresholds = (0.5, 0.35)
    return data


def frame(marked: Marked) -> KeyFrame:
    return KeyFrame(marked, np.zeros((270, 480, 3), np.uint8), np.zeros((270, 270, 3), np.uint8))


def test_the_world_from_above_shows_what_stands_in_it() -> None:
    photo = aerial(WORLD, 0.5)
    x_min, x_max, y_min, y_max = photo.extent
    height, width, _ = photo.picture.shape
    assert (x_max - x_min) / width == pytest.approx((y_max - y_min) / height)
    assert np.array_equal(photo.picture, aerial(WORLD, 0.5).picture)
    bare = aerial(replace(WORLD, boxes=(), trees=()), 0.5)
    changed = np.abs(photo.picture.astype(int) - bare.picture).sum(axis=2) > 10
    things = [(t.x_m, t.y_m) for t in WORLD.trees] + [(b.x_m, b.y_m) for b in WORLD.boxes]
    assert len(things) > 3
    columns = [int((x - x_min) / (x_max - x_min) * width) for x, _ in things]
    rows = [int((y_max - y) / (y_max - y_min) * height) for _, y in things]
    assert changed[rows, columns].mean() > 0.9


@pytest.mark.parametrize("known", ["truth", "odometry", "GPS"])
def test_the_path_is_drawn_by_whatever_tells_where_the_vehicle_was(
    known: str, photo: Aerial, tmp_path: Path
) -> None:
    data = a_flight()
    if known == "truth":
        data.truths = [truth(second) for second in range(10)]
    elif known == "odometry":
        data.path = [(second, 2.0 * second, 0.0) for second in range(10)]
    else:
        data.fixes = [(second, 48.0 + 1e-5 * second, 11.0) for second in range(10)]
    assert path(data, photo, tmp_path / "path.png")
    assert (tmp_path / "path.png").stat().st_size > 5000


def test_without_any_place_there_is_no_map(tmp_path: Path) -> None:
    assert not path(a_flight(), None, tmp_path / "path.png")
    assert not overview(a_flight(), None, [frame(entered(5.0))], tmp_path / "overview.png")


def test_the_overview_needs_a_picture_of_a_junction(photo: Aerial, tmp_path: Path) -> None:
    data = a_flight()
    data.truths = [truth(second) for second in range(10)]
    assert not overview(data, None, [], tmp_path / "overview.png")
    assert overview(data, photo, [frame(entered(5.0))], tmp_path / "overview.png")


def test_probability_and_latency_are_drawn_where_there_are_any(tmp_path: Path) -> None:
    data = a_flight()
    assert probability(data, tmp_path / "probability.png")
    assert not latency(data, tmp_path / "latency.png")
    data.latency_ms, data.rates = [20.0, 25.0], {"frame_capture": [(1.0, 25.0), (2.0, 24.9)]}
    assert latency(data, tmp_path / "latency.png")


def test_turns_are_drawn_on_the_map_where_the_follower_tells_one(tmp_path: Path) -> None:
    data = a_flight()
    begun = entered(6.0).event.model_copy(
        update={"kind": EventKind.TURN_STARTED, "turn": Turn(at=1, turn="left")}
    )
    data.events.append(Marked(6.0, begun, None))
    assert not turns(data, tmp_path / "turns.png")
    data.events.append(Marked(6.0, begun, None, surface(roads(180, 60, -90))))
    assert turns(data, tmp_path / "turns.png")
    drawn = np.asarray(imread(tmp_path / "turns.png"))[..., :3]
    red = (drawn[..., 0] > 0.7) & (drawn[..., 1:].max(axis=2) < 0.3)
    assert red.any(), "the arm of the turn"


@pytest.mark.parametrize(
    ("driven", "counted", "said"),
    [
        ((3, 5, 9), 1, "the count is exact, 2 of 2 junctions"),
        ((3, 5, 8), 1, "the count is exact, 1 of 2 junctions"),
        ((3, 4, 9), 2, "the count is wrong by -1, 0 of 2 junctions"),
    ],
)
def test_count_and_ways_are_held_against_the_truth(
    driven: tuple[int, ...], counted: int, said: str
) -> None:
    data = a_flight()
    data.truths = [truth(0), truth(9, path=driven, junctions_passed=counted)]
    found = verdict(data, (3, 5, 9))
    assert said in found.sentence
    assert "stayed on the road" in found.sentence


def test_without_truth_nothing_is_judged() -> None:
    assert "no ground truth" in verdict(a_flight(), (3, 5)).sentence
