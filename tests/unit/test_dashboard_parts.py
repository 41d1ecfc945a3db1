"""The dashboard's pure parts: journals, roads on pictures, rights, tallies, snapshots, requests."""

import itertools
import json
import struct
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from juncnet import messages as m
from juncnet.camera import CameraGeometry
from juncnet.clocks import Instant
from juncnet_services.dashboard.access import Right, address_in, foreign, new_address
from juncnet_services.dashboard.choices import shipped_models
from juncnet_services.dashboard.journal import Journal
from juncnet_services.dashboard.overlay import road_lines
from juncnet_services.dashboard.requests import FollowerAsked, MissionAsked, OrderAsked, asked
from juncnet_services.dashboard.robots import Robots, key_of
from juncnet_services.dashboard.snapshot import snapshot
from juncnet_services.dashboard.still import grey, still
from juncnet_services.dashboard.tally import Tally
from scenes import score, stamp

MISSION = m.Mission(name="m", turns=(m.Turn(at=1, turn="left"),), finish_after=2)


def now(second: float) -> Instant:
    return Instant(round(second * 1e9), "fake-clock")


def event(
    kind: m.EventKind, second: float = 1.0, index: int = 0, flight: str = "f"
) -> m.JunctionEvent:
    return m.JunctionEvent(
        header=stamp(second), flight=flight, index=index, kind=kind, count=1, probability=0.9
    )


def vehicle(
    second: float = 1.0,
    x_m: float | None = 0.0,
    output: m.Output = m.Output.PIPELINE,
    gps: m.GeoPoint | None = None,
) -> m.VehicleState:
    pose = None if x_m is None else m.Pose(x_m=x_m, y_m=0)
    return m.VehicleState(
        at=stamp(second), capabilities=m.Capabilities(), pose=pose, gps=gps, output=output
    )


def navigation(flight: str = "f", second: float = 1.0) -> m.NavigationState:
    return m.NavigationState(
        header=stamp(second),
        flight=flight,
        phase=m.Phase.FOLLOWING,
        count=1,
        mission=MISSION,
        next_turn=None,
        smoothed=0.25,
        thresholds=m.Thresholds(enter=0.5, certain=0.9, leave=0.3),
    )


def health(second: float = 1.0, pid: int = 1, error: str = "", age_s: float = 0.04) -> m.Health:
    return m.Health(
        service="junction_navigation",
        at=stamp(second),
        flight="f",
        pid=pid,
        rate_hz=25,
        age_s=age_s,
        errors=len(error),
        last_error=error,
    )


def test_a_journal_gives_each_row_once_and_forgets_the_oldest() -> None:
    serials = itertools.count(1)
    one: Journal[str] = Journal(serials, 3)
    other: Journal[str] = Journal(serials, 3)
    for row in "abcd":
        one.add(row)
    other.add("x")
    one.add("e")
    assert one.after(0) == ["c", "d", "e"]
    assert one.after(4) == ["e"]
    assert other.after(4) == ["x"]
    assert one.after(6) == []
    assert one.last == "e"
    one.clear()
    assert one.last is None


def test_a_straight_road_ahead_is_drawn_symmetrically_towards_the_horizon() -> None:
    camera = CameraGeometry()
    lines = road_lines(m.RoadSeen(offset_m=0, heading_rad=0, width_m=6), camera)
    assert all(u == pytest.approx(0.5) for u, _ in lines["centre"])
    for (left, row), (right, same) in zip(lines["left"], lines["right"], strict=True):
        assert left + right == pytest.approx(1.0, abs=2e-4)
        assert row == same
    rows = [row for _, row in lines["centre"]]
    assert rows == sorted(rows, reverse=True)
    assert rows[-1] > camera.horizon_row


def test_a_centre_line_told_by_the_follower_is_drawn_where_it_is() -> None:
    camera = CameraGeometry()
    points = ((4.0, 1.0), (8.0, 1.0))
    road = m.RoadSeen(offset_m=9, heading_rad=0, width_m=2, centre=points)
    lines = road_lines(road, camera)
    for shown, (x, y) in zip(lines["centre"], points, strict=True):
        assert shown == pytest.approx(camera.project(x, y), abs=1e-4)
    for shown, (x, y) in zip(lines["left"], points, strict=True):
        assert shown == pytest.approx(camera.project(x, y + 1), abs=1e-4)


def test_keys_are_kept_in_a_private_file_and_each_gives_its_right(tmp_path: Path) -> None:
    address = address_in(tmp_path)
    assert address_in(tmp_path) == address
    assert address_in(tmp_path, address.port) == address
    assert address_in(tmp_path, address.port + 1).command_key != address.command_key
    assert [path.stat().st_mode & 0o777 for path in tmp_path.iterdir()] == [0o600]
    assert address.right_of(f"Bearer {address.command_key}") is Right.COMMAND
    assert address.right_of(f"Bearer {address.watch_key}") is Right.WATCH
    for wrong in ("", "Bearer ", address.command_key, f"Basic {address.command_key}", "Bearer ü"):
        assert address.right_of(wrong) is Right.NONE
    assert address.url(Right.WATCH).endswith(f":{address.port}/#{address.watch_key}")


def test_all_who_ask_at_once_for_an_address_get_the_same(tmp_path: Path) -> None:
    for attempt in range(20):
        folder = tmp_path / str(attempt)
        folder.mkdir()
        together = threading.Barrier(4)

        def ask(folder: Path = folder, together: threading.Barrier = together) -> str:
            together.wait(10)
            return address_in(folder).command_key

        with ThreadPoolExecutor(4) as pool:
            keys = {future.result(10) for future in [pool.submit(ask) for _ in range(4)]}
        assert keys == {address_in(folder).command_key}
        assert [path.name for path in folder.iterdir()] == ["dashboard.json"]


def test_an_address_that_cannot_be_read_is_made_anew(tmp_path: Path) -> None:
    (tmp_path / "dashboard.json").write_text("not JSON")
    assert address_in(tmp_path) == address_in(tmp_path)


@pytest.mark.parametrize(
    ("host", "origin", "site", "refused"),
    [
        ("127.0.0.1:80", None, None, False),
        ("localhost:80", "http://localhost:80", "same-origin", False),
        ("127.0.0.1:80", None, "none", False),
        ("evil.example:80", None, None, True),
        ("", None, None, True),
        ("127.0.0.1:80", "http://evil.example", None, True),
        ("127.0.0.1:80", "null", None, True),
        ("127.0.0.1:80", "http://localhost:80", None, True),
        ("127.0.0.1:80", None, "cross-site", True),
        ("127.0.0.1:80", None, "same-site", True),
    ],
)
def test_requests_from_elsewhere_are_refused(
    host: str, origin: str | None, site: str | None, refused: bool
) -> None:
    assert (foreign(new_address(80), host, origin, site) is not None) is refused


def test_a_tally_counts_from_the_first_command_to_the_end_of_the_mission() -> None:
    tally = Tally()
    tally.vehicle(vehicle(1.0, output=m.Output.HOLD), (0, 0))
    tally.vehicle(vehicle(2.0), (0, 0))
    tally.vehicle(vehicle(3.0), (3, 4))
    tally.vehicle(vehicle(4.0, output=m.Output.HOLD), (3, 4))
    tally.navigator(health(age_s=0.06))
    tally.navigator(health(age_s=0.05))
    tally.event(event(m.EventKind.TURN_FINISHED))
    assert not tally.finished
    assert tally.seconds is None
    tally.event(event(m.EventKind.MISSION_FINISHED, 32.0))
    tally.vehicle(vehicle(40.0), (100, 100))
    assert tally.as_json() == {
        "finished": True,
        "seconds": 30.0,
        "moved_m": 5.0,
        "turns": 1,
        "holds": 1,
        "oldest_picture_ms": 60.0,
    }


def test_repeated_events_are_shown_once_and_a_new_flight_begins_anew() -> None:
    robots = Robots()
    robots.take("r", navigation(), 0)
    for _ in range(2):
        robots.take("r", event(m.EventKind.APPROACHED), 0)
    robots.take("r", event(m.EventKind.LEFT, index=1), 0)
    assert [row["kind"] for row in robots["r"].events.after(0)] == ["approached", "left"]
    before = robots.serial
    robots.take("r", navigation("g"), 0)
    robots.take("r", event(m.EventKind.APPROACHED, flight="g"), 0)
    assert [row["kind"] for row in robots["r"].events.after(0)] == ["approached"]
    assert len(robots["r"].events.after(before)) == 1


def test_restarts_errors_and_swaps_are_events_too() -> None:
    robots = Robots()
    model = m.ActiveModel(
        model=m.ModelIdentity(name="one", sha256="0" * 64),
        classes=("none", "junction"),
        preprocessing="{}",
        preprocessing_hash="0" * 64,
    )
    other = model.model_copy(update={"model": m.ModelIdentity(name="two", sha256="1" * 64)})
    said = [health(), health(error="bad"), health(error="bad"), health(pid=2, error="bad")]
    for message in [*said, model, model, other, m.ActiveFollower(follower="a:B")]:
        robots.take("r", message, 0)
    kinds = [row["kind"] for row in robots["r"].events.after(0)]
    assert kinds == ["error", "restarted", "swapped"]


def test_a_robot_without_pose_is_placed_by_gps_in_metres_from_its_first_fix() -> None:
    robots = Robots()
    for longitude in (10.0, 10.001):
        fix = m.GeoPoint(latitude_deg=60.0, longitude_deg=longitude)
        robots.take("r", vehicle(x_m=None, gps=fix), 0)
    place = robots["r"].place
    assert place is not None
    assert place == pytest.approx((55.6, 0.0), abs=0.1)  # a degree is 111.2 km, half of it at 60 N
    robots.take("s", vehicle(x_m=None), 0)
    assert robots["s"].place is None


def test_the_number_of_robots_is_bounded_and_what_no_robot_says_is_refused() -> None:
    robots = Robots()
    for n in range(robots.LIMIT + 5):
        robots.take(f"r{n}", vehicle(), 0)
    assert len(robots) == robots.LIMIT
    with pytest.raises(TypeError, match="Mission"):
        robots.take("r0", MISSION, 0)


def test_a_still_has_the_road_and_the_verdict_of_its_own_picture() -> None:
    robots = Robots()
    for second, probability in ((1.0, 0.25), (1.04, 0.75), (1.08, 0.5)):
        robots.take("r", score(second, probability), 0)
    seen = m.RoadSeen(offset_m=0.5, heading_rad=0, width_m=4)
    command = m.RoadCommand(
        header=stamp(1.0), source="s", velocity=m.Velocity(), confidence=0.5, road=seen
    )
    robots.take("r", command, 0)
    ramp = np.linspace(-3, 5, 2 * 64 * 64, dtype=np.float32).reshape(2, 64, 64)
    robots.take("r", m.Features.from_array(ramp, stamp(1.04), "0" * 64), 0)
    image = m.JpegImage.of(b"\xff\xd8jpeg", header=stamp(1.04), width=160, height=90)
    robots.take("r", image, 0)
    data = still(robots["r"], (0, 0), now(1.14), CameraGeometry())
    assert data is not None
    length = struct.unpack_from("<I", data)[0]
    head = json.loads(data[4 : 4 + length])
    assert head["age_s"] == pytest.approx(0.1)
    assert head["score"] == {"junction": 0.75, "label": "junction", "behind": 0}
    assert head["road"]["behind"] == 40
    assert head["road"]["offset_m"] == 0.5
    rest = data[4 + length :]
    assert rest[: head["jpeg_bytes"]] == b"\xff\xd8jpeg"
    assert len(rest) - head["jpeg_bytes"] == 2 * 64 * 64
    assert still(robots["r"], key_of(image.header), now(1.14), CameraGeometry()) is None


def test_features_are_stretched_channel_by_channel() -> None:
    planes = np.stack([np.full((8, 8), 7.0), np.arange(64).reshape(8, 8) / 1e3])
    shown = grey(planes.astype(np.float32))
    assert shown.dtype == np.uint8
    assert not shown[0].any()
    assert shown[1].min() == 0
    assert shown[1].max() == 255


def test_a_snapshot_tells_only_what_is_new_and_which_process_is_silent() -> None:
    robots = Robots()
    robots.take("r", navigation(), 1_000_000_000)
    robots.take("r", health(), 1_000_000_000)
    robots.take("r", vehicle(2.0), 2_000_000_000)
    robots.take("r", score(2.0, 0.5), 2_000_000_000)
    robots.take("r", event(m.EventKind.APPROACHED, 3.0), 3_000_000_000)
    told = json.loads(json.dumps(snapshot(robots, 0, now(5.0))))
    robot = told["robots"]["r"]
    assert robot["navigation"]["thresholds"] == {"enter": 0.5, "certain": 0.9, "leave": 0.3}
    assert robot["navigation"]["mission"]["finish_after"] == 2
    assert robot["scores"] == [[2.0, 0.5]]
    assert robot["events"][0]["ago_s"] == pytest.approx(2.0)
    assert robot["processes"][0]["silent"] is True
    assert robot["vehicle"]["silent_s"] == 3.0
    again = snapshot(robots, told["serial"], now(5.0))["robots"]["r"]
    assert again["scores"] == again["events"] == again["path"] == []


def test_requests_are_checked() -> None:
    assert asked(b'{"robot": "r", "do": "hold"}') == OrderAsked(robot="r", do="hold")
    mission = asked(b'{"robot": "r", "do": "mission", "mission": {"finish_after": 3}}')
    assert isinstance(mission, MissionAsked)
    assert mission.mission.finish_after == 3
    follower = asked(b'{"robot": "r", "do": "follower", "follower": "a:B", "options": {"x": 1}}')
    assert isinstance(follower, FollowerAsked)


@pytest.mark.parametrize(
    "body",
    [
        b"",
        b"[]",
        b'{"do": "hold"}',
        b'{"robot": "r", "do": "emergency"}',
        b'{"robot": "*", "do": "hold"}',
        b'{"robot": "r", "do": "hold", "more": 1}',
        b'{"robot": "r", "do": "mission", "mission": {"turns": [{"at": 0, "turn": "left"}]}}',
        b'{"robot": "r", "do": "model", "model": ""}',
    ],
)
def test_requests_that_are_none_are_refused(body: bytes) -> None:
    with pytest.raises(ValueError, match=r".+: .+"):
        asked(body)


def test_junction_models_are_offered_and_other_networks_are_not() -> None:
    names = shipped_models()
    assert "juncnet" in names
    assert "road-mask" not in names
