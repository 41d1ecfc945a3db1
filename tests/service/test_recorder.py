"""The recorder with a fake bus: what it writes is what was said."""

import json
import shutil
import subprocess
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import SeekingReader
from mcap.records import Message as Record
from mcap.stream_reader import StreamReader
from mcap_protobuf.decoder import DecoderFactory

from fakes import FakeBus
from juncnet.frames import Frame, FrameLayout
from juncnet.messages import (
    ActiveModel,
    Capabilities,
    EventKind,
    JunctionEvent,
    Message,
    ModelIdentity,
    Output,
    PixelFormat,
    Pose,
    Stamp,
    VehicleState,
    VideoPacket,
)
from juncnet.recording import FLIGHT_METADATA
from juncnet.recording.reader import RecordingError, open_recording
from juncnet.recording.repair import is_complete, repair, repair_all
from juncnet.recording.timeline import Shift, restamped
from juncnet.recording.video import VideoDecoder
from juncnet.smaller import smaller
from juncnet.topics import (
    CAMERA_FRAME,
    CAMERA_VIDEO,
    JUNCTION_EVENT,
    MODEL_ACTIVE,
    VEHICLE_STATE,
)
from juncnet_services.recorder.service import Config, run
from juncnet_services.recorder.session import Limits, begin
from juncnet_services.recorder.video import Encoder

LAYOUT = FrameLayout.packed(PixelFormat.I420, 64, 48)
FOXGLOVE = {
    "juncnet/robot/camera/video/payload": "foxglove.CompressedVideo",
    "juncnet/robot/vehicle/state/pose": "foxglove.PoseInFrame",
    "juncnet/robot/junction/event/log": "foxglove.Log",
}
"""What viewers draw, by the schema that they know."""
MODEL = ActiveModel(
    model=ModelIdentity(name="m", sha256="0" * 64),
    classes=("junction", "none"),
    preprocessing="{}",
    preprocessing_hash="0" * 64,
)


def stamp(sequence: int, epoch: int = 1) -> Stamp:
    return Stamp(epoch=epoch, sequence=sequence, time_ns=10**9 + sequence, clock="fake-clock")


def frame(sequence: int) -> Frame:
    pixels = np.full(LAYOUT.nbytes, 40 + sequence % 100, np.uint8)
    return Frame(stamp(sequence), LAYOUT, pixels)


def state(sequence: int) -> VehicleState:
    pose = Pose(x_m=0.5 * sequence, y_m=1.0, yaw_rad=0.2)
    return VehicleState(
        at=stamp(sequence), capabilities=Capabilities(), pose=pose, output=Output.PIPELINE
    )


def event() -> JunctionEvent:
    return JunctionEvent(
        header=stamp(3),
        flight="flight-1",
        index=0,
        kind=EventKind.APPROACHED,
        count=1,
        probability=0.9,
    )


def recorded(folder: Path, frames: int = 10, **options: object) -> FakeBus:
    script: list[object] = [(MODEL_ACTIVE, MODEL)]
    for sequence in range(1, frames + 1):
        script += [(CAMERA_FRAME, frame(sequence)), (VEHICLE_STATE, state(sequence)), 0.04]
    script.append((JUNCTION_EVENT, event()))
    bus = FakeBus(script)  # pyright: ignore[reportArgumentType]
    run(bus, Config.model_validate({"folder": folder, **options}))
    return bus


def test_what_was_said_is_read_again(tmp_path: Path) -> None:
    bus = recorded(tmp_path)
    recording = open_recording(tmp_path)
    assert recording.robot == bus.robot
    assert recording.flight == bus.flight
    assert f"numpy {np.__version__}" in recording.metadata["libraries"]
    items = list(recording.messages())
    states: list[Message] = [i.message for i in items if i.topic.key == VEHICLE_STATE.key]
    assert states == [state(n) for n in range(1, 11)]
    assert [i.message for i in items if i.topic.key == JUNCTION_EVENT.key] == [event()]
    assert [i.message for i in items if i.topic.key == MODEL_ACTIVE.key] == [MODEL]
    times = [i.time_ns for i in items]
    assert times == sorted(times)
    assert bus.health.errors == []


def test_pictures_come_back_under_their_headers(tmp_path: Path) -> None:
    recorded(tmp_path)
    decoder = VideoDecoder()
    frames = [
        picture
        for item in open_recording(tmp_path).messages([CAMERA_VIDEO.key])
        for picture in decoder.decode(item.message)
    ]
    assert [f.header for f in frames] == [stamp(n) for n in range(1, 11)]
    for sequence, picture in enumerate(frames, 1):
        assert abs(float(picture.luminance().mean()) - (40 + sequence)) < 3.0


def test_wider_pictures_are_recorded_smaller(tmp_path: Path) -> None:
    recorded(tmp_path, max_width=32)
    decoder, found = VideoDecoder(), list[Frame]()
    for item in open_recording(tmp_path).messages([CAMERA_VIDEO.key]):
        found += decoder.decode(item.message)
    assert [(f.header, f.width, f.height) for f in found] == [
        (stamp(n), 32, 24) for n in range(1, 11)
    ]
    assert abs(float(found[-1].luminance().mean()) - 50) < 3.0


def test_the_cameras_own_video_is_kept_as_it_came(tmp_path: Path) -> None:
    own = VideoPacket.of(b"\0\0\0\1\x65camera", header=stamp(1), key_frame=True)
    run(FakeBus([(CAMERA_VIDEO, own)]), Config(folder=tmp_path, video=False))
    (item,) = open_recording(tmp_path).messages([CAMERA_VIDEO.key])
    assert bytes(item.message.payload) == bytes(own.payload)
    assert item.message.header == own.header


def test_a_full_file_is_followed_by_one_that_opens_by_itself(tmp_path: Path) -> None:
    bus = FakeBus([])
    session = begin(bus, tmp_path, Limits(20_000, 0, 0))
    session.write("robot", MODEL_ACTIVE, MODEL)
    for sequence in range(300):
        session.write("robot", VEHICLE_STATE, state(sequence))
    session.close()
    files = sorted(tmp_path.glob("*.mcap"))
    assert len(files) > 1
    whole = [i.message for i in open_recording(files[0]).messages([VEHICLE_STATE.key])]
    assert whole == [state(n) for n in range(300)]
    last = Counter(i.topic.key for i in open_recording(files[-1]).messages())
    assert last[MODEL_ACTIVE.key] == 1
    assert all(is_complete(file) for file in files)


def test_a_disk_without_room_ends_the_recording_with_a_complete_file(tmp_path: Path) -> None:
    bus = recorded(tmp_path, stop_free_mb=10**9, warn_free_mb=10**9)
    assert any("full" in text for text in bus.health.errors)
    assert all(is_complete(path) for path in tmp_path.glob("*.mcap"))


def test_low_disk_is_said_before_it_is_full(tmp_path: Path) -> None:
    bus = recorded(tmp_path, stop_free_mb=0, warn_free_mb=10**9)
    assert [text for text in bus.health.errors if "nearly full" in text]
    assert len(list(open_recording(tmp_path).messages([VEHICLE_STATE.key]))) == 10


@pytest.mark.parametrize("kept", [0.3, 0.7, 0.95])
def test_a_truncated_recording_opens_and_is_repaired(tmp_path: Path, kept: float) -> None:
    recorded(tmp_path, frames=400)
    (path,) = tmp_path.glob("*.mcap")
    whole = len(list(open_recording(path).messages()))
    data = path.read_bytes()
    path.write_bytes(data[: int(kept * len(data))])
    assert not is_complete(path)
    left = list(open_recording(path).messages())
    assert 0.5 * kept * whole < len(left) <= whole
    repair(path)
    assert is_complete(path)
    assert [i.message for i in open_recording(path).messages()] == [i.message for i in left]


def states(path: Path) -> list[Message]:
    return [item.message for item in open_recording(path).messages([VEHICLE_STATE.key])]


def test_two_recorders_of_a_flight_leave_each_others_files_alone(tmp_path: Path) -> None:
    bus, limits = FakeBus([]), Limits(20_000, 0, 0)
    first = begin(bus, tmp_path, limits)
    for sequence in range(300):
        first.write("robot", VEHICLE_STATE, state(sequence))
    second = begin(bus, tmp_path, limits)
    for sequence in range(300, 600):
        first.write("robot", VEHICLE_STATE, state(sequence))
        second.write("robot", VEHICLE_STATE, state(sequence))
    first.close()
    second.close()
    assert states(tmp_path / "flight-1-000.mcap") == [state(n) for n in range(600)]
    assert states(tmp_path / "flight-1.2-000.mcap") == [state(n) for n in range(300, 600)]
    assert all(is_complete(path) for path in tmp_path.iterdir())


def test_a_recorder_goes_on_behind_a_predecessor_that_was_killed(tmp_path: Path) -> None:
    recorded(tmp_path, frames=100)
    (path,) = tmp_path.glob("*.mcap")
    path.write_bytes(path.read_bytes()[:-100])
    recorded(tmp_path, frames=100)
    assert is_complete(path)
    assert states(path) == 2 * [state(n) for n in range(1, 101)]


def test_a_file_that_has_just_been_created_is_not_repaired(tmp_path: Path) -> None:
    path = tmp_path / "flight-1-000.mcap"
    path.touch()
    before = path.stat().st_ino
    assert repair_all(tmp_path) == []
    assert path.stat().st_ino == before


def test_what_is_no_recording_is_refused_by_name(tmp_path: Path) -> None:
    noise = tmp_path / "noise.mcap"
    noise.write_bytes(b"no MCAP at all")
    with pytest.raises(RecordingError, match=r"noise\.mcap: not an MCAP file"):
        open_recording(noise)
    with pytest.raises(RecordingError, match="no recording"):
        open_recording(tmp_path)
    with pytest.raises(RecordingError, match="No such file"):
        open_recording(tmp_path / "absent.mcap")


def test_restamping_keeps_order_and_distances() -> None:
    shift = Shift(10**9, 5 * 10**9, "now", epoch=70, speed=2.0, epochs=(1, 2))
    moved = restamped(event(), shift)
    assert moved.header == Stamp(epoch=70, sequence=3, time_ns=5 * 10**9 + 2, clock="now")
    assert shift.stamp(stamp(1, epoch=2)).epoch == 71
    assert moved.model_copy(update={"header": event().header}) == event()


def test_no_picture_is_shown_between_a_loss_and_the_next_key_frame() -> None:
    encoder, decoder = Encoder(24, 4), VideoDecoder()
    packets = [encoder.encode(frame(n)) for n in range(1, 9)]
    lossy = VideoPacket.of(
        packets[2].payload, header=packets[2].header, key_frame=False, lost_before=1
    )
    shown = [f for p in [packets[0], lossy, *packets[3:]] for f in decoder.decode(p)]
    assert [f.header.sequence for f in shown] == [1, 5, 6, 7, 8]
    assert decoder.skipped == 2


def test_a_new_size_begins_with_a_key_frame() -> None:
    encoder = Encoder(24, 25)
    first, second = encoder.encode(frame(1)), encoder.encode(frame(2))
    wide = FrameLayout.packed(PixelFormat.I420, 96, 48)
    other = encoder.encode(Frame(stamp(3), wide, np.zeros(wide.nbytes, np.uint8)))
    assert (first.key_frame, second.key_frame, other.key_frame) == (True, False, True)


@pytest.mark.parametrize("kind", [PixelFormat.BGR8, PixelFormat.GRAY8])
@pytest.mark.parametrize("size", [(640, 361), (1241, 376), (3, 3)])
def test_an_odd_picture_loses_its_last_row_or_column(
    tmp_path: Path, kind: PixelFormat, size: tuple[int, int]
) -> None:
    layout = FrameLayout.packed(kind, *size)
    odd = Frame(stamp(1), layout, np.full(layout.nbytes, 90, np.uint8))
    run(FakeBus([(CAMERA_FRAME, odd), 0.04]), Config(folder=tmp_path))
    width, height = smaller(odd, 960).width, smaller(odd, 960).height
    (item,) = open_recording(tmp_path).messages([CAMERA_VIDEO.key])
    (shown,) = VideoDecoder().decode(item.message)
    assert (shown.width, shown.height) == (width // 2 * 2, height // 2 * 2)
    assert abs(float(shown.bgr().mean()) - 90) < 4.0


@pytest.fixture(name="file", params=["complete", "repaired"])
def _file(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    recorded(tmp_path, frames=60)
    (path,) = tmp_path.glob("*.mcap")
    if request.param == "repaired":
        data = path.read_bytes()
        path.write_bytes(data[: int(0.7 * len(data))])
        repair(path)
    return path


def test_checksums_hold_and_the_index_finds_every_message(file: Path) -> None:
    with file.open("rb") as stream:
        records = StreamReader(stream, validate_crcs=True).records
        there = Counter(r.channel_id for r in records if isinstance(r, Record))
    with file.open("rb") as stream:
        reader = SeekingReader(stream, validate_crcs=True)
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        found = Counter(channel.id for _, channel, _ in reader.iter_messages())
        assert [a.name for a in reader.iter_attachments()] == []
        assert [m.name for m in reader.iter_metadata()] == [FLIGHT_METADATA]
    assert found == there == summary.statistics.channel_message_counts
    assert summary.statistics.message_count == sum(there.values()) > 60


def test_every_channel_says_how_it_is_read(file: Path) -> None:
    schemas = dict[str, str]()
    with file.open("rb") as stream:
        reader = SeekingReader(stream, decoder_factories=[DecoderFactory()])
        for schema, channel, message in reader.iter_messages():
            assert schema is not None
            schemas[channel.topic] = schema.name
            if channel.message_encoding == "json":
                required: list[str] = json.loads(schema.data).get("required", [])
                assert set(required) <= set(json.loads(message.data))
        decoded: dict[str, Any] = {
            c.topic: d for _, c, _, d in reader.iter_decoded_messages(FOXGLOVE)
        }
    assert FOXGLOVE.items() <= schemas.items()
    assert decoded["juncnet/robot/camera/video/payload"].format == "h264"
    assert decoded["juncnet/robot/vehicle/state/pose"].pose.position.x > 10


def test_rerun_finds_nothing_wrong_with_it(file: Path) -> None:
    rerun = shutil.which("rerun")
    if rerun is None:
        pytest.skip("no rerun here: pip install rerun-sdk")
    done = subprocess.run([rerun, "mcap", "check", "--full", str(file)], capture_output=True)
    said = done.stdout.decode()
    assert done.returncode == 0, said + done.stderr.decode()
    assert {f"/{topic}" for topic in FOXGLOVE} <= set(said.split())
