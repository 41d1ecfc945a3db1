"""A replay for viewers is seen by the tools that visit a flight, pictures included."""

import tempfile
import threading
from collections.abc import Generator
from functools import partial
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

import peers
from fakes import FakeBus, ScriptItem
from juncnet.flight import flights_root
from juncnet.frames import Frame, FrameLayout
from juncnet.launch import connect
from juncnet.messages import PixelFormat
from juncnet.recording.reader import open_recording
from juncnet.topics import CAMERA_FRAME, CAMERA_IMAGE, JUNCTION_EVENT
from juncnet_services.cli.replay_play import show
from juncnet_services.recorder.service import Config, run
from scenes import stamp

LAYOUT = FrameLayout.packed(PixelFormat.I420, 64, 48)
PICTURES = 400
WAIT_S = 60.0


def recorded(folder: Path) -> Path:
    """Write a recording of some pictures, each with a junction event, and return its folder."""
    script: list[ScriptItem] = []
    for number in range(PICTURES):
        picture = Frame(stamp(0.04 * number), LAYOUT, np.full(LAYOUT.nbytes, 90, np.uint8))
        script += [(CAMERA_FRAME, picture), 0.04, partial(tell, number)]
    run(FakeBus(script, "recorder", folder), Config(folder=folder))
    return folder


def tell(index: int, bus: FakeBus) -> None:
    for inbox in bus._inboxes[JUNCTION_EVENT.key]:  # pyright: ignore[reportPrivateUsage]
        event = peers.event(cast("Any", bus), index)
        inbox.put(bus.robot, event)


@pytest.fixture(name="flights")
def _flights(monkeypatch: pytest.MonkeyPatch) -> Generator[Path]:
    """Return the folder of this test's own flights, in a short path."""
    with tempfile.TemporaryDirectory(prefix="jn-") as folder:
        monkeypatch.setenv("XDG_RUNTIME_DIR", folder)
        yield flights_root()


def test_a_tool_hears_events_and_sees_pictures_of_a_replay(tmp_path: Path, flights: Path) -> None:
    recording = open_recording(recorded(tmp_path))
    steps = threading.Semaphore(0)

    def next_step() -> None:
        steps.acquire(timeout=WAIT_S)

    thread = threading.Thread(target=show, args=(recording, 1.0, next_step))
    thread.start()
    try:
        assert peers.eventually(lambda: any(flights.glob("*/frame_capture.zsock")), WAIT_S)
        (directory,) = flights.iterdir()
        with connect(directory, timeout_s=WAIT_S) as bus:
            events, images = bus.subscribe(JUNCTION_EVENT, 100), bus.subscribe(CAMERA_IMAGE)

            def seen() -> bool:
                steps.release()
                return events.newest is not None and images.newest is not None

            assert peers.eventually(seen, WAIT_S)
            assert images.newest is not None
            assert (images.newest.width, images.newest.height) == (64, 48)
    finally:
        for _ in range(PICTURES):
            steps.release()
        thread.join(WAIT_S)
    assert not thread.is_alive()
