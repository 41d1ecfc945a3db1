"""A flight recorded, its recorder killed; the recording read, replayed and reported."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from flights import SMALL_CAMERA, Flying
from juncnet.messages import EventKind, Mission
from juncnet.recording.reader import open_recording
from juncnet.recording.repair import is_complete, repair_all
from juncnet.topics import CAMERA_VIDEO, JUNCTION_EVENT, VEHICLE_STATE
from juncnet_services.cli.demo import prepare
from juncnet_services.cli.replay_check import check
from juncnet_services.cli.replay_play import fly, recorded_events
from juncnet_services.report.write import write_report

LOST_S = 1.0
"""What a killed recorder may lose."""
CAMERA = ("simulator.width=640", "simulator.height=360")


def recorder(folder: Path, flight: Path) -> "subprocess.Popen[bytes]":
    code = "from juncnet_services.cli.main import main; main()"
    words = ["record", "--out", str(folder), "--connect", str(flight)]
    return subprocess.Popen([sys.executable, "-c", code, *words], stderr=subprocess.DEVNULL)


def seconds_of_video(folder: Path) -> float:
    try:
        items = list(open_recording(folder).messages([CAMERA_VIDEO.key]))
    except ValueError:
        return 0.0
    return (items[-1].time_ns - items[0].time_ns) / 1e9 if items else 0.0


def finished_on_disk(folder: Path) -> bool:
    events = recorded_events(open_recording(folder))
    return any(event.kind is EventKind.MISSION_FINISHED for event in events)


def test_a_killed_recorder_loses_at_most_the_last_second(tmp_path: Path, folder: Path) -> None:
    with Flying(prepare("copter", None, 24, None, SMALL_CAMERA)) as flying:
        flying.all_report()
        process = recorder(tmp_path, flying.flight.directory)
        try:
            flying.until(lambda: seconds_of_video(tmp_path) > 4, "four seconds are recorded")
            errors = dict(flying.errors)
            killed_ns = time.time_ns()
            process.send_signal(signal.SIGKILL)
            process.wait(5)
            flying.moves(0.5, faster_than_mps=0.0)
            flying.hear()
            assert flying.errors == errors, "the flight notices that its recorder died"
        finally:
            process.kill()
    (path,) = tmp_path.glob("*.mcap")
    assert not is_complete(path)
    last = {item.topic.key: item.time_ns for item in open_recording(path).messages()}
    for key in (VEHICLE_STATE.key, CAMERA_VIDEO.key):
        assert (killed_ns - last[key]) / 1e9 < LOST_S
    assert repair_all(tmp_path) == [path]
    assert is_complete(path)
    assert {i.topic.key: i.time_ns for i in open_recording(path).messages()} == last


@pytest.mark.full
def test_a_replay_of_a_killed_recorders_file_gives_the_events_of_the_flight(
    tmp_path: Path, folder: Path
) -> None:
    mission = Mission(name="two", finish_after=2)
    with Flying(prepare("copter", None, 24, mission, CAMERA)) as flying:
        flying.all_report()
        process = recorder(tmp_path, flying.flight.directory)
        events = flying.bus.subscribe(JUNCTION_EVENT, 1000)
        finished: list[EventKind] = []

        def over() -> bool:
            finished.extend(event.kind for _, event in events.drain())
            return EventKind.MISSION_FINISHED in finished

        flying.until(over, "the mission is finished", 120.0)
        flying.until(lambda: finished_on_disk(tmp_path), "the end of the mission is on disk", 10.0)
        process.kill()
        process.wait(5)
    recording = open_recording(tmp_path)
    assert not is_complete(recording.files[0])
    flown = [(e.kind, e.count) for e in recorded_events(recording)]
    assert flown[-1][0] is EventKind.MISSION_FINISHED
    report = check(recording, [])
    assert report.frames > 200
    assert report.events.same, report.text()
    replayed = fly(recording, 1.0, None, [])
    assert replayed.same, replayed.text()
    written = write_report(recording, tmp_path / "flight.html")
    text = written[0].read_text()
    assert recording.flight in text
    assert text.count("Radon reconstruction") == 2
    assert "http://" not in text
    assert "https://" not in text
    assert os.path.getsize(written[0]) > 50_000
