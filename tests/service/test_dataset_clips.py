"""Clips by their names: on contact sheets, and where a split asks for them."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from juncnet.learning.datasets import DatasetInfo, Row, write_dataset
from juncnet.learning.footage.intervals import FootageError
from juncnet.learning.footage.sides import Rules
from juncnet_services.cli import dataset
from juncnet_services.cli.dataset import check
from juncnet_services.cli.dataset.clips import Clip
from juncnet_services.cli.dataset.extract import Extraction, Sampling
from juncnet_services.cli.dataset.film import write_video


def test_a_contact_sheet_names_the_clip_of_every_picture(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out, rows = tmp_path / "set", list[Row]()
    for number in range(4):
        label = ("none", "junction")[number % 2]
        rows.append(Row(f"{number}.png", label, f"elm/day{number}.mp4", "elm", "", 1.5))
    write_dataset(out, DatasetInfo(classes=("none", "junction"), made_by="a test"), rows)
    for row in rows:
        assert cv2.imwrite(str(out / row.path), np.zeros((8, 8), np.uint8))
    captions: list[str] = []

    def note(title: str, pictures: list[Any], words: list[str]) -> NDArray[np.uint8]:
        captions.extend(words)
        return np.zeros((8, 8, 3), np.uint8)

    monkeypatch.setattr(check, "contact_sheet", note)
    dataset.main(["check", str(out), "--near-duplicate", "0"])
    assert sorted(captions) == [f"elm/day{number}  1.5 s" for number in range(4)]


def test_names_of_a_split_are_checked_before_anything_is_decoded(tmp_path: Path) -> None:
    clips = [Clip(f"{c}.mp4", tmp_path / "gone.mp4", "elm", c) for c in ("none", "junction")]
    extraction = Extraction(tmp_path / "set", Sampling(0.2, 0.25, 360))
    with pytest.raises(FootageError, match=r"no site or clip is called 'nowhere\*'"):
        extraction.run(clips, Rules(test=("nowhere*",)), None, "a test")


def test_all_videos_that_cannot_be_read_are_named_before_anything_is_decoded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    frames = [np.full(64 * 48 * 3 // 2, 90, np.uint8)] * 2
    write_video(tmp_path / "good.mp4", frames, (64, 48), 10)
    for name in ("bad.mp4", "worse.mp4"):
        (tmp_path / name).write_bytes(b"no video")
    clips = [
        Clip(name, tmp_path / name, "elm", label)
        for name, label in (("good.mp4", "none"), ("bad.mp4", "junction"), ("worse.mp4", "none"))
    ]
    extraction = Extraction(tmp_path / "set", Sampling(0.2, 0.25, 360))

    def add(clip: Clip) -> int:
        pytest.fail(f"{clip.name} is decoded")

    monkeypatch.setattr(extraction, "add", add)
    with pytest.raises(FootageError, match=r"2 of 3 videos: .*bad\.mp4 cannot .*worse\.mp4 cannot"):
        extraction.run(clips, Rules(), None, "a test")
