"""frame_capture over the fake bus."""

from collections.abc import Generator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from pydantic import ValidationError

from fakes import FakeBus
from juncnet.frames import Frame, FrameLayout
from juncnet.messages import PixelFormat, Stamp
from juncnet.topics import CAMERA_FRAME, CAMERA_IMAGE, CAMERA_VIDEO, SIMULATOR_CAMERA
from juncnet_services.frame_capture.contract import AccessUnit, Counts, Picture
from juncnet_services.frame_capture.jpeg import JpegOptions
from juncnet_services.frame_capture.output import CameraOutput
from juncnet_services.frame_capture.planes import write_pixels
from juncnet_services.frame_capture.service import Config, run
from videos import band_of, write_video


def simulated(sequence: int, value: int, width: int = 64, height: int = 48) -> Frame:
    layout = FrameLayout.packed(PixelFormat.I420, width, height)
    header = Stamp(
        epoch=9, sequence=sequence, time_ns=7 * sequence, clock="drone", uncertainty_ns=3
    )
    return Frame(header, layout, np.full(layout.nbytes, value, np.uint8))


def file_config(path: Path, **options: Any) -> Config:
    source = {"kind": "file", "path": path, "pace": "fastest"}
    return Config.model_validate({"source": source, "exit_at_end": True, **options})


def test_simulated_pictures_pass_with_their_own_header() -> None:
    sent = [simulated(1, 10), simulated(2, 20, 128, 96), simulated(5, 20)]
    bus = FakeBus([(SIMULATOR_CAMERA, frame) for frame in sent])
    run(bus, Config())
    got = bus.frames[CAMERA_FRAME.key]
    assert [frame.header for frame in got] == [frame.header for frame in sent]
    assert [frame.layout for frame in got] == [frame.layout for frame in sent]
    assert [int(frame.pixels[-1]) for frame in got] == [10, 20, 20]
    assert bus.health.counters["lost"] == 2
    assert bus.health.outputs == 3


def test_resting_simulated_robot_is_not_frozen() -> None:
    bus = FakeBus([(SIMULATOR_CAMERA, simulated(index, 10)) for index in range(12)])
    run(bus, Config())
    assert len(bus.frames[CAMERA_FRAME.key]) == 12
    assert bus.health.errors == []


def test_file_gives_frames_video_and_images(tmp_path: Path) -> None:
    bus = FakeBus([0.0])
    run(bus, file_config(write_video(tmp_path / "road.mp4", 12), image={"max_width": 160}))
    frames = bus.frames[CAMERA_FRAME.key]
    assert [band_of(frame.luminance()) for frame in frames] == list(range(12))
    assert [frame.header.sequence for frame in frames] == list(range(12))
    assert {frame.header.epoch for frame in frames} == {bus.epoch}
    units = bus.published[CAMERA_VIDEO.key]
    assert [unit.key_frame for unit in units] == [index % 10 == 0 for index in range(12)]
    image = bus.published[CAMERA_IMAGE.key][0]
    assert (image.width, image.height) == (160, 120)
    assert image.header == frames[0].header
    assert bus.health.counters["end_of_file"] == 1


def test_nobody_listens_nothing_is_encoded(tmp_path: Path) -> None:
    bus = FakeBus([0.0], subscribers=False)
    run(bus, file_config(write_video(tmp_path / "road.mp4", 3)))
    assert len(bus.frames[CAMERA_FRAME.key]) == 3
    assert bus.published[CAMERA_IMAGE.key] == []
    assert bus.published[CAMERA_VIDEO.key] == []


def test_forwarding_without_decoding(tmp_path: Path) -> None:
    bus = FakeBus([0.0])
    run(bus, file_config(write_video(tmp_path / "road.mp4", 5), decode=False))
    assert bus.frames[CAMERA_FRAME.key] == []
    assert len(bus.published[CAMERA_VIDEO.key]) == 5


def test_service_stays_alive_after_the_end(tmp_path: Path) -> None:
    bus = FakeBus([1.0, 1.0, 1.0])
    path = write_video(tmp_path / "road.mp4", 2)
    run(bus, file_config(path, exit_at_end=False))
    assert not bus.running
    assert len(bus.frames[CAMERA_FRAME.key]) == 2
    assert bus.health.counters["end_of_file"] == 1


def test_missing_file_ends_with_code_2_and_an_explanation(tmp_path: Path) -> None:
    bus = FakeBus([0.0])
    with pytest.raises(SystemExit) as caught:
        run(bus, file_config(tmp_path / "none.mp4"))
    assert caught.value.code == 2
    assert "none.mp4 does not exist" in bus.health.errors[0]


def test_folder(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "a.png"), np.full((20, 30, 3), 90, np.uint8))
    bus = FakeBus([0.0])
    source = {"kind": "folder", "path": tmp_path, "pace": "fastest"}
    run(bus, Config.model_validate({"source": source, "exit_at_end": True}))
    assert [int(frame.pixels[0]) for frame in bus.frames[CAMERA_FRAME.key]] == [90]


class StuckCamera:
    """A live camera that has counted something; the test shows its pictures itself."""

    live, ended = True, False

    def __init__(self) -> None:
        self.counts = Counts(lost=4)

    @contextmanager
    def take(self, timeout_s: float) -> Generator[Picture | None]:
        yield None

    def access_units(self) -> list[AccessUnit]:
        return []

    def want_key_frame(self) -> None:
        pass

    def close(self) -> None:
        pass


def test_frozen_live_camera_is_reported_and_withheld() -> None:
    bus = FakeBus()
    output = CameraOutput(bus, StuckCamera(), JpegOptions(), frozen_limit=5)
    layout = FrameLayout.packed(PixelFormat.GRAY8, 16, 16)
    for index in range(10):
        value = 0 if index == 0 else 60
        pixels = np.full(layout.nbytes, value, np.uint8)
        output.show(Picture(layout, partial(write_pixels, pixels), index))
    output.report()
    output.close()
    assert len(bus.frames[CAMERA_FRAME.key]) == 7
    assert bus.health.counters["frozen"] == 6
    assert len(bus.health.errors) == 1
    assert "frozen" in bus.health.errors[0]
    assert bus.health.counters["lost"] == 4


@pytest.mark.parametrize(
    "options",
    [
        {"sauce": {}},
        {"source": {"kind": "telescope"}},
        {"source": {"kind": "file", "path": "a.mp4", "lop": True}},
        {"source": {"kind": "rtp", "port": 0}},
        {"source": {"kind": "rtp", "port": 5600, "sender": "drone.local"}},
    ],
)
def test_mistyped_options_are_refused(options: dict[str, Any]) -> None:
    with pytest.raises(ValidationError):
        Config.model_validate(options)
