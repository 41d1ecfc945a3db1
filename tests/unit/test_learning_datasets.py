"""Datasets: both kinds are read alike, stay on disk, and say what is wrong with them."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from juncnet.learning.datasets import (
    DatasetError,
    DatasetInfo,
    Row,
    open_dataset,
    sites_of,
    write_dataset,
    write_info,
)
from juncnet.learning.samples import Samples

INFO = DatasetInfo(classes=("none", "junction"), made_by="a test")


def write_pictures(folder: Path) -> list[Row]:
    rows: list[Row] = []
    for i, name in enumerate(("none", "junction", "none")):
        (folder / name).mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(folder / name / f"{i}.png"), np.full((20, 30, 3), 40 * i, np.uint8))
        rows.append(Row(f"{name}/{i}.png", name, f"clip{i}", f"site{i}", "train", 0.5 * i))
    return rows


def samples(n: int) -> Samples:
    rng = np.random.default_rng(n)
    label = (np.arange(n) % 3).astype(np.uint8)
    return Samples(
        gray=rng.integers(0, 255, (n, 64, 64), dtype=np.uint8),
        target=np.where(label == 2, 0.25, label).astype(np.float32),
        label=label,
        mouth_m=np.ones(n, np.float32),
        height_m=np.ones(n, np.float32),
        site=np.arange(n) // 2,
        mask=rng.integers(0, 3, (n, 32, 32), dtype=np.uint8),
    )


def test_pictures_with_a_table(tmp_path: Path) -> None:
    write_dataset(tmp_path, INFO, write_pictures(tmp_path))
    dataset = open_dataset(tmp_path)
    assert dataset.label.tolist() == [0, 1, 0]
    assert dataset.target.tolist() == [[1, 0], [0, 1], [1, 0]]
    assert dataset.clip.tolist() == ["clip0", "clip1", "clip2"]
    assert dataset.site[1] == "site1"
    assert dataset.time_s.tolist() == [0.0, 0.5, 1.0]
    assert dataset.info == INFO
    assert dataset.picture(1).shape == (20, 30, 3)
    np.testing.assert_array_equal(dataset.luminance(2), 80)
    assert dataset.masks() is None


def test_class_folders_alone(tmp_path: Path) -> None:
    write_pictures(tmp_path)
    dataset = open_dataset(tmp_path)
    assert dataset.classes == ("none", "junction")
    assert set(dataset.site.tolist()) == {""}
    sites, known = sites_of(dataset)
    assert len(set(sites.tolist())) == 3
    assert not known


def test_a_folder_a_site_in_class_folders(tmp_path: Path) -> None:
    for name in ("junction/elm", "none/elm", "none/oak"):
        (tmp_path / name).mkdir(parents=True)
        for number in range(2):
            cv2.imwrite(str(tmp_path / name / f"{number}.png"), np.zeros((4, 4, 3), np.uint8))
    dataset = open_dataset(tmp_path)
    assert dataset.site.tolist() == ["elm", "elm", "oak", "oak", "elm", "elm"]
    assert sites_of(dataset)[1]
    cv2.imwrite(str(tmp_path / "none" / "0.png"), np.zeros((4, 4, 3), np.uint8))
    with_one_alone = open_dataset(tmp_path)
    assert set(with_one_alone.site.tolist()) == {"", "elm", "oak"}
    sites, known = sites_of(with_one_alone)
    assert set(sites.tolist()) == {"none/0", "elm", "oak"}
    assert not known


def test_shards_stay_on_disk_and_are_read_in_any_order(tmp_path: Path) -> None:
    parts = [samples(5), samples(7)]
    for i, part in enumerate(parts):
        part.save(tmp_path / f"{i}.npz")
    write_info(tmp_path, INFO.model_copy(update={"shards": ("0.npz", "1.npz")}))
    dataset = open_dataset(tmp_path)
    whole = Samples.concatenate(parts)
    assert whole.mask is not None
    assert dataset.label.tolist() == [-1 if v == 2 else int(v) for v in whole.label]
    np.testing.assert_array_equal(dataset.target[:, 1], whole.target)
    order = [11, 0, 4, 5]
    chosen = dataset.take(order)
    for i, row in enumerate(order):
        np.testing.assert_array_equal(chosen.picture(i), whole.gray[row])
    np.testing.assert_array_equal(chosen.whole_shards(), whole.gray[order])
    np.testing.assert_array_equal(chosen.masks(), whole.mask[order])
    assert len(dataset.where(dataset.site == "0")) == 4


@pytest.mark.parametrize(
    ("file", "text", "said"),
    [
        ("samples.csv", None, "samples.csv is missing"),
        ("dataset.json", '{"classes": ["one"]}', "classes"),
        ("samples.csv", "path,class\n", "no column clip"),
    ],
)
def test_what_is_wrong_is_said(tmp_path: Path, file: str, text: str | None, said: str) -> None:
    write_dataset(tmp_path, INFO, write_pictures(tmp_path))
    (tmp_path / file).unlink()
    if text is not None:
        (tmp_path / file).write_text(text)
    with pytest.raises(DatasetError, match=said):
        open_dataset(tmp_path)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("junction,clip1", "car,clip1", "line 3: class 'car' is none of none, junction"),
        ("site1,train", "site1,train2", "split 'train2' is none of"),
        ("0.500", "soon", "time_s 'soon' is no number"),
    ],
)
def test_a_bad_line_is_named(tmp_path: Path, old: str, new: str, said: str) -> None:
    write_dataset(tmp_path, INFO, write_pictures(tmp_path))
    table = tmp_path / "samples.csv"
    table.write_text(table.read_text().replace(old, new))
    with pytest.raises(DatasetError, match=said):
        open_dataset(tmp_path)


def test_a_table_of_another_program_is_read_or_its_line_is_named(tmp_path: Path) -> None:
    write_dataset(tmp_path, INFO, write_pictures(tmp_path))
    table = tmp_path / "samples.csv"
    text = table.read_text().replace("clip1", "caf\u00e9")
    table.write_bytes(text.encode("utf-8-sig"))
    assert open_dataset(tmp_path).clip[1] == "caf\u00e9"
    table.write_bytes(text.encode("latin-1"))
    with pytest.raises(DatasetError, match=r"samples.csv, line 3: not UTF-8"):
        open_dataset(tmp_path)


def test_a_picture_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    write_dataset(tmp_path, INFO, write_pictures(tmp_path))
    (tmp_path / "none/0.png").write_bytes(b"no picture")
    (tmp_path / "none/2.png").unlink()
    dataset = open_dataset(tmp_path)
    for index in (0, 2):
        with pytest.raises(DatasetError, match=f"none/{index}.png"):
            dataset.picture(index)


def test_folders_that_are_no_datasets(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match="no such folder"):
        open_dataset(tmp_path / "nowhere")
    with pytest.raises(DatasetError, match="fewer than two class folders"):
        open_dataset(tmp_path)
    write_info(tmp_path, INFO.model_copy(update={"shards": ("0.npz",)}))
    np.savez_compressed(tmp_path / "0.npz", gray=np.zeros((2, 64, 64), np.uint8))
    with pytest.raises(DatasetError, match="it is compressed"):
        open_dataset(tmp_path)
