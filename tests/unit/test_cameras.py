"""Cameras and what they are made of: recordings, damage, pacing, frozen pictures."""

import os
import struct
import zlib
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from fakes import FakeClock
from juncnet.frames import Frame, FrameLayout
from juncnet.messages import PixelFormat, Stamp
from juncnet_services.frame_capture.contract import Camera, CameraError, Picture
from juncnet_services.frame_capture.decoding import TimeSteps
from juncnet_services.frame_capture.file import FileCamera
from juncnet_services.frame_capture.folder import FolderCamera
from juncnet_services.frame_capture.frozen import FrozenGate, fingerprint
from juncnet_services.frame_capture.h264 import IDR, PPS, SPS, H264Track, nal_type, split_annex_b
from juncnet_services.frame_capture.jpeg import JpegOptions, encode_jpeg
from juncnet_services.frame_capture.pacing import Backoff, Pace
from juncnet_services.frame_capture.planes import picture_of
from juncnet_services.frame_capture.sources import FileSource, FolderSource, RtpSource
from juncnet_services.frame_capture.stream import make_sdp
from videos import band_of, encode, mux, write_video

STAMP = Stamp(epoch=1, sequence=1, time_ns=1, clock="fake-clock", uncertainty_ns=0)


def frame_of(picture: Picture) -> Frame:
    pixels = np.zeros(picture.layout.nbytes, np.uint8)
    picture.write(pixels)
    return Frame(STAMP, picture.layout, pixels)


def play(camera: Camera, at_most: int = 1000) -> list[Frame]:
    frames: list[Frame] = []
    for _ in range(at_most):
        with camera.take(0.1) as picture:
            if picture is not None:
                frames.append(frame_of(picture))
        if camera.ended:
            break
    return frames


def file_camera(path: Path, loop: bool = False, decode: bool = True) -> FileCamera:
    source = FileSource(kind="file", path=path, pace=Pace.FASTEST, loop=loop)
    return FileCamera(source, FakeClock(), lambda _: None, decode=decode)


@pytest.mark.parametrize("suffix", [".mp4", ".ts", ".h264"])
def test_every_picture_of_a_file_comes_once_in_order(tmp_path: Path, suffix: str) -> None:
    camera = file_camera(write_video(tmp_path / f"road{suffix}", 25))
    frames = play(camera)
    assert [band_of(frame.luminance()) for frame in frames] == [index % 15 for index in range(25)]
    assert camera.ended
    assert (camera.counts.lost, camera.counts.corrupt, camera.counts.skipped) == (0, 0, 0)


def test_full_hd_file(tmp_path: Path) -> None:
    frames = play(file_camera(write_video(tmp_path / "road.mp4", 3, 1920, 1080)))
    assert [band_of(frame.luminance()) for frame in frames] == [0, 1, 2]
    assert frames[0].layout == FrameLayout.packed(PixelFormat.I420, 1920, 1080)


def test_looped_file_begins_again_and_never_ends(tmp_path: Path) -> None:
    camera = file_camera(write_video(tmp_path / "road.mp4", 5), loop=True)
    frames = play(camera, at_most=12)
    assert [band_of(frame.luminance()) for frame in frames] == [0, 1, 2, 3, 4] * 2 + [0, 1]
    assert not camera.ended


def test_file_keeps_its_own_pace(tmp_path: Path) -> None:
    clock = FakeClock()
    source = FileSource(kind="file", path=write_video(tmp_path / "road.mp4", 6))
    camera = FileCamera(source, clock, clock.advance, decode=True)
    captured: list[int] = []
    while not camera.ended:
        with camera.take(0.015) as picture:
            if picture is not None:
                captured.append(picture.captured_ns)
    assert np.diff(captured) == pytest.approx([40e6] * 5, abs=2)


def test_file_that_was_held_up_goes_on_from_now(tmp_path: Path) -> None:
    clock = FakeClock()
    source = FileSource(kind="file", path=write_video(tmp_path / "road.mp4", 6))
    camera = FileCamera(source, clock, clock.advance, decode=True)
    play(camera, at_most=2)
    clock.advance(10)
    resumed_ns = clock.now_ns()
    play(camera)
    assert (clock.now_ns() - resumed_ns) / 1e9 == pytest.approx(0.04 * 3, abs=0.001)


def test_access_units_of_a_file_decode_by_themselves(tmp_path: Path) -> None:
    camera = file_camera(write_video(tmp_path / "road.mp4", 12), decode=False)
    assert play(camera) == []
    units = camera.access_units()
    assert [unit.key_frame for unit in units] == [index % 10 == 0 for index in range(12)]
    kinds = {nal_type(nal) for nal in split_annex_b(units[10].payload)}
    assert {SPS, PPS, IDR} <= kinds
    decoded = _decode([unit.payload for unit in units[10:]])
    assert [band_of(luminance) for luminance in decoded] == [10, 11]


def test_lost_packets_show_nothing_until_the_next_key_frame(tmp_path: Path) -> None:
    units = _units_of(write_video(tmp_path / "whole.mp4", 25))
    path = tmp_path / "holes.h264"
    path.write_bytes(b"".join(u for index, u in enumerate(units) if index not in (3, 4)))
    camera = file_camera(path)
    shown = [band_of(frame.luminance()) for frame in play(camera)]
    assert shown == [index % 15 for index in [*range(3), *range(10, 25)]]
    assert (camera.counts.lost, camera.counts.skipped) == (2, 5)


def test_joining_in_the_middle_waits_for_a_key_frame(tmp_path: Path) -> None:
    units = _units_of(write_video(tmp_path / "whole.mp4", 15))
    path = tmp_path / "late.h264"
    path.write_bytes(b"".join(units[6:]))
    camera = file_camera(path)
    assert [band_of(frame.luminance()) for frame in play(camera)] == [10, 11, 12, 13, 14]
    assert camera.counts.skipped == 4


def test_damaged_picture_is_counted_and_never_shown(tmp_path: Path) -> None:
    units = _units_of(write_video(tmp_path / "whole.mp4", 25))
    whole = _decode(units)
    units[12] = units[12][: len(units[12]) // 2]
    path = tmp_path / "damaged.h264"
    path.write_bytes(b"".join(units))
    camera = file_camera(path)
    shown = [frame.luminance() for frame in play(camera)]
    assert camera.counts.corrupt == 1
    expected = [*range(12), *range(20, 25)]
    assert len(shown) == len(expected)
    assert all(np.array_equal(mine, whole[i]) for mine, i in zip(shown, expected, strict=True))


def test_truncated_transport_stream_gives_what_is_whole(tmp_path: Path) -> None:
    path = write_video(tmp_path / "road.ts", 25)
    data = path.read_bytes()
    path.write_bytes(data[: len(data) * 2 // 3])
    camera = file_camera(path)
    shown = [band_of(frame.luminance()) for frame in play(camera)]
    assert 10 <= len(shown) < 25
    assert shown == [index % 15 for index in range(len(shown))]
    assert camera.ended


def test_size_may_change_within_a_file(tmp_path: Path) -> None:
    small = _units_of(write_video(tmp_path / "small.mp4", 3, 320, 240))
    large = _units_of(write_video(tmp_path / "large.mp4", 3, 640, 480))
    path = tmp_path / "both.h264"
    path.write_bytes(b"".join([*small, *large]))
    frames = play(file_camera(path))
    assert [frame.width for frame in frames] == [320] * 3 + [640] * 3
    assert [band_of(frame.luminance()) for frame in frames] == [0, 1, 2] * 2


@pytest.mark.parametrize(
    ("content", "words"),
    [(None, "does not exist"), (b"this is no video" * 100, "cannot be read"), (b"", "cannot be")],
)
def test_unreadable_file_is_explained(tmp_path: Path, content: bytes | None, words: str) -> None:
    path = tmp_path / "road.mp4"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(CameraError, match=words):
        file_camera(path)


def test_video_without_its_index_is_explained(tmp_path: Path) -> None:
    path = write_video(tmp_path / "road.mp4", 25)
    path.write_bytes(path.read_bytes()[:2000])
    with pytest.raises(CameraError, match="is it complete"):
        file_camera(path)


def test_folder_in_order_of_names_at_its_rate(tmp_path: Path) -> None:
    for index in (2, 0, 1):
        cv2.imwrite(str(tmp_path / f"{index}.png"), np.full((10, 13, 3), 50 * index, np.uint8))
    (tmp_path / "notes.txt").write_text("no picture")
    clock = FakeClock()
    source = FolderSource(kind="folder", path=tmp_path, fps=10)
    camera = FolderCamera(source, clock, clock.advance)
    began_ns = clock.now_ns()
    frames = play(camera)
    assert [int(frame.plane()[0, 0, 0]) for frame in frames] == [0, 50, 100]
    assert frames[0].layout == FrameLayout.packed(PixelFormat.BGR8, 13, 10)
    assert clock.now_ns() - began_ns == pytest.approx(0.2e9, abs=10)


def test_looped_folder_skips_what_it_cannot_read(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "0.png"), np.full((8, 8, 3), 50, np.uint8))
    (tmp_path / "1.png").write_bytes(b"broken")
    source = FolderSource(kind="folder", path=tmp_path, loop=True, pace=Pace.FASTEST)
    camera = FolderCamera(source, FakeClock(), lambda _: None)
    assert len(play(camera, at_most=6)) == 3
    assert camera.counts.corrupt == 3
    assert "1.png" in camera.counts.problems[0]


def test_folder_of_broken_pictures_ends_though_looped(tmp_path: Path) -> None:
    (tmp_path / "1.png").write_bytes(b"broken")
    source = FolderSource(kind="folder", path=tmp_path, loop=True, pace=Pace.FASTEST)
    camera = FolderCamera(source, FakeClock(), lambda _: None)
    assert play(camera) == []
    assert camera.ended


def test_folder_skips_pictures_of_sizes_that_no_frame_has(tmp_path: Path) -> None:
    for name, size in (("0", (8, 8)), ("1", (1, 1)), ("2", (8, 16385)), ("4", (9, 8))):
        cv2.imwrite(str(tmp_path / f"{name}.png"), np.full((*size, 3), 50, np.uint8))
    header = struct.pack(">IIBBBBB", 60_000, 60_000, 8, 2, 0, 0, 0)
    chunk = b"IHDR" + header
    bomb = b"\x89PNG\r\n\x1a\n" + struct.pack(">I", 13) + chunk
    (tmp_path / "3.png").write_bytes(bomb + struct.pack(">I", zlib.crc32(chunk)))
    source = FolderSource(kind="folder", path=tmp_path, pace=Pace.FASTEST)
    camera = FolderCamera(source, FakeClock(), lambda _: None)
    assert [frame.height for frame in play(camera)] == [8, 9]
    assert camera.ended
    assert [text.split(":")[0][-5:] for text in camera.counts.problems] == [
        "1.png",
        "2.png",
        "3.png",
    ]


def test_folder_shows_pictures_whose_names_are_in_no_encoding(tmp_path: Path) -> None:
    coded = cv2.imencode(".png", np.full((8, 8, 3), 50, np.uint8))[1].tobytes()
    (tmp_path / os.fsdecode(b"caf\xe9.png")).write_bytes(coded)
    source = FolderSource(kind="folder", path=tmp_path, pace=Pace.FASTEST)
    assert len(play(FolderCamera(source, FakeClock(), lambda _: None))) == 1


def test_file_of_a_size_that_no_frame_has_plays_without_pictures(tmp_path: Path) -> None:
    path = tmp_path / "thin.mov"
    with av.open(str(path), "w") as container:
        # av's stubs leave the type of further options open.
        stream = container.add_stream("png", rate=25)  # pyright: ignore[reportUnknownMemberType]
        stream.width, stream.height, stream.pix_fmt = 1, 8, "gray"
        frames = [av.VideoFrame.from_ndarray(np.zeros((8, 1), np.uint8), format="gray")] * 3
        for packet in encode(stream, frames):
            mux(container, packet)
    camera = file_camera(path)
    assert play(camera) == []
    assert camera.ended
    assert camera.counts.corrupt == 3
    assert "1x8 outside 2..16384" in camera.counts.problems[0]


@pytest.mark.parametrize(("name", "words"), [("", "has no picture"), ("none", "does not exist")])
def test_useless_folder_is_explained(tmp_path: Path, name: str, words: str) -> None:
    source = FolderSource(kind="folder", path=tmp_path / name)
    with pytest.raises(CameraError, match=words):
        FolderCamera(source, FakeClock(), lambda _: None)


@pytest.mark.parametrize(
    ("av_format", "kind"),
    [
        ("yuv420p", PixelFormat.I420),
        ("yuvj420p", PixelFormat.I420),
        ("nv12", PixelFormat.NV12),
        ("bgr24", PixelFormat.BGR8),
        ("gray", PixelFormat.GRAY8),
        ("yuyv422", PixelFormat.I420),
    ],
)
def test_planes_lose_their_padding(av_format: str, kind: PixelFormat) -> None:
    rng = np.random.default_rng(1)
    coarse = rng.integers(0, 256, (4, 6, 3), np.uint8)
    smooth = np.asarray(cv2.resize(coarse, (66, 34)), dtype=np.uint8)
    source = av.VideoFrame.from_ndarray(smooth, format="bgr24").reformat(format=av_format)
    frame = frame_of(picture_of(source, 0))
    assert frame.layout == FrameLayout.packed(kind, 66, 34)
    expected = source.reformat(format="bgr24").to_ndarray()
    difference = np.abs(frame.bgr().astype(int) - expected.astype(int))
    assert difference.mean() < 8


def test_odd_i420_loses_its_last_row_and_column() -> None:
    source = av.VideoFrame.from_ndarray(np.full((35, 67), 90, np.uint8), format="gray")
    frame = frame_of(picture_of(source.reformat(format="yuv420p"), 0))
    assert (frame.width, frame.height) == (66, 34)


def test_frame_numbers_tell_lost_pictures(tmp_path: Path) -> None:
    units = _units_of(write_video(tmp_path / "road.mp4", 10))
    track = H264Track()
    gaps = [track.lost_before(split_annex_b(unit)) for unit in [*units[:4], *units[7:]]]
    assert gaps == [None, 0, 0, 0, 3, 0, 0]


def test_time_steps_tell_lost_pictures_through_jitter() -> None:
    steps = TimeSteps()
    stamps = [0, 40, 79, 121, 160, 280, 320, None, 361, 10, 50]
    assert [steps.lost_before(stamp) for stamp in stamps] == [0] * 5 + [2] + [0] * 5


def test_frozen_pictures_are_withheld_until_one_differs() -> None:
    gate = FrozenGate(limit=5)
    shown = [gate.accept(picture) for picture in [1, *[2] * 8, 3, 3]]
    assert shown == [True] * 7 + [False] * 2 + [True] * 2
    assert not gate.frozen


def test_frozen_is_called_at_the_third_repeat_and_never_withheld_with_limit_zero() -> None:
    gate = FrozenGate(limit=0)
    seen = [(gate.accept(7), gate.frozen, gate.just_frozen) for _ in range(5)]
    assert seen == [
        (True, False, False),
        (True, False, False),
        (True, False, False),
        (True, True, True),
        (True, True, False),
    ]


@pytest.mark.parametrize("kind", [PixelFormat.I420, PixelFormat.BGR8, PixelFormat.GRAY8])
def test_fingerprint_differs_with_sensor_noise(kind: PixelFormat) -> None:
    layout = FrameLayout.packed(kind, 64, 48)
    quiet: NDArray[np.uint8] = np.full(layout.nbytes, 100, np.uint8)
    noise = np.random.default_rng(2).integers(0, 3, layout.nbytes, np.uint8)
    still = fingerprint(Frame(STAMP, layout, quiet))
    assert still == fingerprint(Frame(STAMP, layout, quiet.copy()))
    assert still != fingerprint(Frame(STAMP, layout, quiet + noise))


def test_jpeg_is_no_wider_than_asked() -> None:
    layout = FrameLayout.packed(PixelFormat.GRAY8, 640, 360)
    frame = Frame(STAMP, layout, np.full(layout.nbytes, 77, np.uint8))
    image = encode_jpeg(frame, JpegOptions(max_width=320))
    decoded = cv2.imdecode(np.frombuffer(image.payload, np.uint8), cv2.IMREAD_GRAYSCALE)
    assert decoded is not None
    assert decoded.shape == (180, 320) == (image.height, image.width)
    assert abs(float(np.mean(decoded)) - 77) < 2


def test_backoff_doubles_up_to_its_end_and_starts_over() -> None:
    backoff = Backoff()
    assert [backoff.next_s() for _ in range(6)] == [0.5, 1, 2, 4, 8, 8]
    backoff.reset()
    assert backoff.next_s() == 0.5


def test_session_description_names_port_payload_and_codec() -> None:
    sdp = make_sdp(RtpSource(kind="rtp", port=55004), "192.168.42.1")
    assert "m=video 55004 RTP/AVP 96\r\n" in sdp
    assert "a=rtpmap:96 H264/90000\r\n" in sdp
    assert "a=source-filter: incl IN IP4 * 192.168.42.1\r\n" in sdp


def _units_of(path: Path) -> list[bytes]:
    camera = file_camera(path, decode=False)
    play(camera)
    return [unit.payload for unit in camera.access_units()]


def _decode(units: list[bytes]) -> list[NDArray[np.uint8]]:
    """Return the luminances of Annex B access units, by a decoder that knows nothing else."""
    decoder = av.VideoCodecContext.create("h264", "r")
    found: list[NDArray[np.uint8]] = []
    for packet in [*(av.Packet(unit) for unit in units), None]:
        # av's stubs leave the type of packets open.
        frames = decoder.decode(packet)  # pyright: ignore[reportUnknownMemberType]
        found.extend(frame_of(picture_of(frame, 0)).luminance() for frame in frames)
    return found
