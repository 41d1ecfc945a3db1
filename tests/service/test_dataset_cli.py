"""`juncnet dataset`: from videos to a data set, and its check."""

import json
import shutil
import sys
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
import pytest
from av.video.frame import VideoFrame

from juncnet.camera import CameraGeometry
from juncnet.extras import install_command
from juncnet.frames import Frame, FrameLayout
from juncnet.learning.datasets import (
    DatasetInfo,
    Row,
    open_dataset,
    read_info,
    read_rows,
    write_dataset,
    write_info,
)
from juncnet.learning.footage.drives import junction_drives, labels_of, path_of, poses, road_drives
from juncnet.learning.footage.intervals import FootageError
from juncnet.messages import PixelFormat, Stamp
from juncnet.recording import FLIGHT_METADATA
from juncnet.recording.writer import RecordingWriter
from juncnet.simulation.towns import named_world
from juncnet.simulation.truth import GroundTruth
from juncnet.topics import CAMERA_VIDEO, ROOT
from juncnet_services.cli import dataset
from juncnet_services.cli.dataset.film import write_video as write_i420
from juncnet_services.cli.dataset.frames import FrameStore
from juncnet_services.cli.dataset.videos import Video, videos_in, whole_frame
from juncnet_services.recorder.video import Encoder
from videos import add_h264, band_of, bands, encode, mux, picture, write_video


def rows_of(directory: Path) -> list[Row]:
    return read_rows(directory, read_info(directory))


def write_standing(path: Path, index: int, count: int) -> None:
    """Write a video that shows one picture all the time."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with av.open(str(path), "w") as container:
        stream = add_h264(container, 320, 240)
        one = [VideoFrame.from_ndarray(picture(index, 320, 240), format="bgr24")] * count
        for packet in encode(stream, one):
            mux(container, packet)


@pytest.fixture
def footage(tmp_path: Path) -> Path:
    """Class folders: three sites with one clip of each of two classes."""
    root = tmp_path / "videos"
    for number, label in enumerate(("none", "junction")):
        for site in ("elm", "oak", "ash"):
            write_standing(root / label / site / "a.mp4", 3 + 5 * number + len(root.name), 13)
    return root


def test_class_folders_become_a_data_set_without_near_duplicates(
    footage: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "set"
    code = dataset.main(
        ["extract", str(footage), "--out", str(out), "--every", "0.1", "--seen-sites"]
    )
    assert code == 0, capsys.readouterr().err
    rows = rows_of(out)
    assert {(r.label, r.clip, r.site, r.time_s) for r in rows} == {
        (label, f"{label}/{site}/a.mp4", site, 0.0)
        for label in ("none", "junction")
        for site in ("elm", "oak", "ash")
    }, "a clip that stands still gives one frame"
    info = read_info(out)
    assert info.classes == ("none", "junction")
    assert info.notes["split_by"] == "frame"
    assert "within clips" in info.notes["near_duplicates"]
    assert open_dataset(out).picture(0).shape == (240, 320, 3)


def test_an_interval_file_labels_clips_and_splits_by_site(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = ["clip,from,to,class,site"]
    for site in ("elm", "oak", "ash", "fir"):
        write_video(tmp_path / f"{site}.mp4", 50)
        lines += [f"{site}.mp4,0:00,0.8,none,{site}", f"{site}.mp4,1.2,2,left,{site}"]
    (tmp_path / "labels.csv").write_text("\n".join(lines) + "\n")
    out = tmp_path / "set"
    arguments = ["extract", "--labels", str(tmp_path / "labels.csv"), "--out", str(out)]
    more = ["--near-duplicate", "0", "--test", "fir", "--limit", "21", "--shares", "67,33,0"]
    assert dataset.main([*arguments, *more]) == 0, capsys.readouterr().err
    rows = rows_of(out)
    assert all((r.time_s < 0.8) == (r.label == "none") for r in rows)
    assert not [r for r in rows if 0.8 <= r.time_s < 1.2], "what no interval holds is left out"
    assert {r.site for r in rows if r.split == "test"} == {"fir"}
    assert len({(r.site, r.split) for r in rows}) == 4
    assert read_info(out).notes["seen_sites"] == "no"
    learnt = [r for r in rows if r.split != "test"]
    assert 18 <= len(learnt) <= 21
    assert {r.label for r in learnt} == {"none", "left"}
    assert dataset.main([*arguments]) == 2
    assert "is not empty" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("labels", "arguments", "says"),
    [
        (None, ["{}"], "in no class folder"),
        (None, [], "name a folder of class folders"),
        ("clip,from,to,class\nb.mp4,0,1,none\n", ["--labels", "{}/labels.csv"], "not among"),
        ("clip,from,to,class\na.mp4,0,1,none\n", ["--labels", "{}/labels.csv"], "two classes"),
        ("clip,from,to\n", ["--labels", "{}/labels.csv"], "no column class"),
        (None, ["{}", "--shares", "1"], "three numbers"),
        (None, ["{}", "--site-from", "("], "--site-from '(' is no regular expression"),
        (
            "clip,from,to,class\na.mp4,0,1,none\n",
            ["--labels", "{}/labels.csv", "--height", "0"],
            "16",
        ),
        (
            "clip,from,to,class\na.mp4,0,1,none\n",
            ["--labels", "{}/labels.csv", "--rest", "no class"],
            "class 'no class': use letters",
        ),
        (
            "clip,from,to,class\na.mp4,0,1,none\n",
            ["--labels", "{}/labels.csv", "--limit", "0"],
            "--limit 2 or more",
        ),
    ],
)
def test_wrong_input_is_named(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    labels: str | None,
    arguments: list[str],
    says: str,
) -> None:
    write_video(tmp_path / "a.mp4", 5)
    if labels:
        (tmp_path / "labels.csv").write_text(labels)
    filled = [argument.format(tmp_path) for argument in arguments]
    assert dataset.main(["extract", *filled, "--out", str(tmp_path / "set")]) == 2
    assert says in capsys.readouterr().err
    assert not (tmp_path / "set").exists() or not any((tmp_path / "set").iterdir())


def test_class_folders_are_checked_before_anything_is_decoded(
    footage: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    extract = ["extract", str(footage), "--out", str(tmp_path / "set")]
    (footage / "junction").rename(footage / "plain junction")
    assert dataset.main(extract) == 2
    said = capsys.readouterr()
    assert "class 'plain junction': use letters" in said.err
    (footage / "plain junction").rename(footage / "junction")
    (footage / "none").rename(footage / "road")
    assert dataset.main(extract) == 2
    said = capsys.readouterr()
    assert "no class is called `none`" in said.err
    assert "frames" not in said.out


def test_commands_and_their_absence(capsys: pytest.CaptureFixture[str]) -> None:
    assert dataset.main(["--help"]) == 0
    assert dataset.main([]) == 2
    assert dataset.main(["extrakt"]) == 2
    assert "no command 'extrakt'" in capsys.readouterr().err


def test_a_missing_package_names_its_extra(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "av", None)
    for name in ("extract", "videos"):
        monkeypatch.delitem(sys.modules, f"juncnet_services.cli.dataset.{name}", raising=False)
    assert dataset.main(["extract", "v", "--out", "o"]) == 2
    assert install_command("laptop") in capsys.readouterr().err


def make_set(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Path:
    for number in range(6):
        site = tmp_path / "v" / ("none" if number % 2 else "junction") / f"s{number}"
        site.mkdir(parents=True)
        write_video(site / "a.mp4", 20)
    out = tmp_path / "set"
    split = ["--validation", "s0", "s1", "--test", "s2", "s3"]
    every = ["--near-duplicate", "0", "--every", "0.3"]
    assert dataset.main(["extract", str(tmp_path / "v"), "--out", str(out), *split, *every]) == 0
    capsys.readouterr()
    return out


def check(out: Path, capsys: pytest.CaptureFixture[str], *more: str) -> tuple[int, dict[str, Any]]:
    code = dataset.main(["check", str(out), "--json", *more])
    return code, json.loads(capsys.readouterr().out)


def test_check_tells_counts_and_writes_contact_sheets(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = make_set(tmp_path, capsys)
    code, report = check(out, capsys, "--near-duplicate", "0")
    assert (code, report["sound"]) == (0, True)
    assert report["counts"]["none"] == {"train": 3, "validation": 3, "test": 3}
    assert report["sites"]["s3"] == {"none": 3}
    assert len(report["sheets"]) == 6
    sheet = cv2.imread(report["sheets"][0])
    assert sheet is not None
    assert sheet.shape[1] > 3 * 192
    assert dataset.main(["check", str(out), "--near-duplicate", "0"]) == 0
    assert "sound" in capsys.readouterr().out


def test_check_names_what_is_wrong(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = make_set(tmp_path, capsys)
    rows = rows_of(out)
    broken, missing = out / rows[0].path, out / rows[4].path
    broken.write_bytes(broken.read_bytes()[:900])
    missing.unlink()
    shutil.copy(out / rows[1].path, out / "pictures" / "stray.jpg")
    code, report = check(out, capsys)
    assert code == 1
    assert set(report["unreadable"]) == {rows[0].path, rows[4].path}
    assert report["unlisted"] == ["pictures/stray.jpg"]
    twins = [leak for leak in report["leaks"] if leak["kind"] == "near_duplicate"]
    assert twins, "all these clips show the same"
    assert not twins[0]["asked_for"]
    table = out / "samples.csv"
    table.write_text(table.read_text().replace(",s2,test,", ",s2,train,").replace(",s3,", ",s1,"))
    code, report = check(out, capsys)
    assert {(leak["kind"], leak["what"]) for leak in report["leaks"]} >= {("site", "s1")}
    assert any("no picture of 'junction' in test" in problem for problem in report["problems"])
    assert dataset.main(["check", str(tmp_path / "v")]) == 2
    assert "no dataset.json" in capsys.readouterr().err


def test_an_empty_table_is_not_sound(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_dataset(tmp_path, DatasetInfo(classes=("none", "junction")), [])
    code, report = check(tmp_path, capsys)
    assert (code, report["sound"]) == (1, False)
    assert "there are no pictures" in report["problems"][0]


def test_check_reads_shards_and_class_folders_too(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rng = np.random.default_rng(1)
    shards = tmp_path / "shards"
    shards.mkdir()
    np.savez(
        shards / "a.npz",
        gray=rng.integers(0, 255, (6, 64, 64), dtype=np.uint8),
        label=np.array([0, 1, 2, 0, 1, 2], np.uint8),
        target=np.array([0, 1, 0.5, 0, 1, 0.5], np.float32),
        site=np.arange(6) // 2,
    )
    write_info(shards, DatasetInfo(classes=("none", "junction"), shards=("a.npz",)))
    code, report = check(shards, capsys)
    assert (code, report["n"]) == (0, 6)
    assert report["counts"]["no-class"] == {"": 2}
    assert len(report["sheets"]) == 3
    assert dataset.main(["check", str(shards)]) == 0
    assert "undecided" in capsys.readouterr().out
    for label in ("none", "junction"):
        (tmp_path / "folders" / label).mkdir(parents=True)
        cv2.imwrite(str(tmp_path / "folders" / label / "a.png"), picture(3, 64, 48))
    code, report = check(tmp_path / "folders", capsys)
    assert (code, report["counts"]) == (0, {"none": {"": 1}, "junction": {"": 1}})
    assert [Path(sheet).parent for sheet in report["sheets"]] == [tmp_path / "folders-check"] * 2
    assert open_dataset(tmp_path / "folders").classes == ("none", "junction")


def test_check_of_class_folders_names_files_and_makes_no_class(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folders = tmp_path / "folders"
    for label in ("none", "junction"):
        (folders / label / "elm").mkdir(parents=True)
        cv2.imwrite(str(folders / label / "elm" / "a.jpg"), picture(3, 64, 48))
    (folders / "none" / "elm" / "a.jpg").write_bytes(b"no picture")
    code, report = check(folders, capsys)
    assert (code, report["unreadable"], report["unlisted"]) == (1, ["none/elm/a.jpg"], [])
    assert dataset.main(["check", str(folders), "--sheets", str(folders / "sheets")]) == 2
    assert "would be a class" in capsys.readouterr().err
    (folders / "none").rename(folders / "plain road")
    assert dataset.main(["check", str(folders)]) == 2
    assert "plain road: a class is named by letters" in capsys.readouterr().err


def test_frames_come_by_index_in_any_order(tmp_path: Path) -> None:
    video = Video(write_video(tmp_path / "a.mp4", 40))
    assert len(video.times_s) == 40
    assert video.duration_s == pytest.approx(1.6)
    store = FrameStore(video, 160, cache_bytes=20_000)
    for index in (0, 1, 30, 7, 39, 12):
        data = np.frombuffer(store.picture(index), np.uint8)
        gray = cv2.imdecode(data, cv2.IMREAD_GRAYSCALE)
        assert gray is not None
        assert gray.shape == (120, 160)
        means = np.asarray(gray, float).mean(axis=1).reshape(-1, 8).mean(axis=1)
        assert int(means.argmax()) == index % 15, "the band stands where this frame has it"
    with pytest.raises(FootageError, match="no frame 40"):
        store.picture(40)


def test_raw_h264_without_times_counts_its_frames(tmp_path: Path) -> None:
    video = Video(write_video(tmp_path / "a.h264", 12))
    assert video.times_s == pytest.approx([k / 25 for k in range(12)])
    assert [index for index, _ in video.frames(5)] == list(range(5, 12))


def test_pictures_that_are_shown_in_another_order_count_as_shown(tmp_path: Path) -> None:
    path = tmp_path / "b.h264"
    with av.open(str(path), "w") as container:
        stream = add_h264(container, 320, 240)
        stream.options = {"preset": "medium", "x264-params": "threads=1:bframes=2:b-adapt=0"}
        for packet in encode(stream, bands(30, 320, 240)):
            mux(container, packet)
    found = list(Video(path).frames())
    assert [index for index, _ in found] == list(range(30))
    assert [band_of(whole_frame(frame).luminance()) for _, frame in found] == [
        index % 15 for index in range(30)
    ]


def record(path: Path, count: int, lost: int | None = None) -> Path:
    """Write a recording of ten pictures a second without the video packet `lost`."""
    encoder, frames = Encoder(23, 10), [picture(index, 320, 240) for index in range(count)]
    layout = FrameLayout.packed(PixelFormat.BGR8, 320, 240)
    writer = RecordingWriter(path)
    writer.metadata(FLIGHT_METADATA, {"flight": "f", "robot": "r"})
    for index, pixels in enumerate(frames):
        header = Stamp(epoch=1, sequence=index, time_ns=10**9 + index * 10**8, clock="c")
        packet = encoder.encode(Frame(header, layout, pixels.reshape(-1)))
        if index != lost:
            writer.message(f"{ROOT}/r/{CAMERA_VIDEO.key}", packet, header.time_ns, header.time_ns)
    writer.close()
    return path


def test_frames_behind_a_lost_picture_keep_their_times(tmp_path: Path) -> None:
    video = Video(record(tmp_path / "f-000.mcap", 30, lost=13))
    found = [
        (round(10 * video.times_s[index]), band_of(whole_frame(frame).luminance()))
        for index, frame in video.frames()
    ]
    assert 20 in [tenth for tenth, _ in found], "it goes on at a key frame"
    assert 14 not in [tenth for tenth, _ in found], "what has lost its reference is left out"
    assert all(band == tenth % 15 for tenth, band in found)


def test_a_recording_is_footage_with_its_own_times(tmp_path: Path) -> None:
    video = Video(record(tmp_path / "f-000.mcap", 8))
    assert video.times_s == pytest.approx([index / 10 for index in range(8)])
    assert [index for index, _ in video.frames(3)] == [3, 4, 5, 6, 7]
    (tmp_path / "f-001.mcap").write_bytes(b"")
    assert videos_in(tmp_path) == [tmp_path / "f-000.mcap"]
    with pytest.raises(FootageError, match=r"not one of juncnet record|not an MCAP file"):
        Video(tmp_path / "f-001.mcap")


def test_what_is_no_video_is_said(tmp_path: Path) -> None:
    (tmp_path / "a.mp4").write_bytes(b"no video")
    with pytest.raises(FootageError, match=r"a\.mp4 cannot be read"):
        Video(tmp_path / "a.mp4")
    with pytest.raises(FootageError, match="does not exist"):
        Video(tmp_path / "b.mp4")


def test_simulated_drives_show_their_junction_and_plain_roads_none(tmp_path: Path) -> None:
    world, camera = named_world("crossing_town"), CameraGeometry()
    truth = GroundTruth(world)
    node = min(truth.network.junctions)
    rng = np.random.default_rng(1)
    for drive in junction_drives(world, node, 40.0, 20.0):
        where = poses(path_of(world, drive), 3.0, 5.0, rng)
        labels = labels_of(truth, where, camera, drive)
        passed = [truth.junction_of(x, y) == node for x, y, _ in where.tolist()]
        assert any(passed)
        assert "junction" not in labels[passed.index(True) :]
        steps = np.hypot(*np.diff(where[:, :2], axis=0).T)
        assert np.median(steps) == pytest.approx(0.6, rel=0.1)
        assert np.abs(np.diff(where[:, 2])).max() < 0.5, "turns are rounded"
    for drive in road_drives(world, camera, 20.0)[:4]:
        where = poses(path_of(world, drive), 3.0, 5.0, rng)
        assert "junction" not in labels_of(truth, where, camera, drive)
    frames = [np.full(64 * 48 * 3 // 2, 90 + k, np.uint8) for k in range(4)]
    assert write_i420(tmp_path / "a" / "b.mp4", frames, (64, 48), 10) == 4
    assert Video(tmp_path / "a" / "b.mp4").times_s == pytest.approx([0.0, 0.1, 0.2, 0.3])
