"""Table IV, the ablation and the benchmarks, on data so small that they take seconds."""

import gzip
import json
import struct
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

pytest.importorskip("torch", reason="torch is not installed: deploy/test --with-train")
pytest.importorskip("sklearn", reason="scikit-learn is not installed: deploy/test --with-train")

import torch

from juncnet.features import Extractor, Preprocessing
from juncnet.learning.datasets import DatasetInfo, write_info
from juncnet.learning.evaluation import small_pictures
from juncnet.learning.evaluation.ablation import VARIANTS
from juncnet.learning.evaluation.classical import (
    Classical,
    gradients,
    train_neighbours,
    train_support_vectors,
)
from juncnet.learning.evaluation.contestants import NAMES, RIVALS
from juncnet.learning.evaluation.image_sets import ImageSetError, load_cifar10, load_mnist
from juncnet.learning.evaluation.small_pictures import ColourExtractor, varied
from juncnet.learning.samples import Samples
from juncnet_services.cli import ablate, benchmark, compare


def pictures(n: int, seed: int = 0) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Return noise (N, 64, 64), and labels: with 1 there is a bright bar across the middle."""
    rng = np.random.default_rng(seed)
    gray = rng.integers(0, 100, (n, 64, 64), np.uint8)
    label = (np.arange(n) % 2).astype(np.uint8)
    gray[label == 1, 28:40] += 120
    return gray, label


@pytest.fixture
def roads(tmp_path: Path) -> Path:
    """Return a dataset of six sites."""
    return write_roads(tmp_path / "roads")


def write_roads(
    folder: Path,
    seed: int = 0,
    n: int = 120,
    classes: tuple[str, ...] = ("none", "junction"),
) -> Path:
    gray, label = pictures(n, seed)
    folder.mkdir()
    Samples(
        gray=gray,
        target=label.astype(np.float32),
        label=label,
        mouth_m=np.full(n, 5, np.float32),
        height_m=np.full(n, 2, np.float32),
        site=np.repeat(np.arange(6), n // 6),
    ).save(folder / "a.npz")
    write_info(folder, DatasetInfo(classes=classes, shards=("a.npz",)))
    return folder


@pytest.mark.parametrize("name", RIVALS)
def test_every_network_takes_the_input_and_answers_for_every_class(name: str) -> None:
    network = RIVALS[name].make(2, 3, 0.1).eval()
    with torch.no_grad():
        assert network(torch.zeros(2, 2, 64, 64)).shape == (2, 3)


@pytest.mark.parametrize("train", [train_neighbours, train_support_vectors])
def test_kernels_and_neighbours_tell_a_bar_from_noise(train: Callable[..., Classical]) -> None:
    gray, label = pictures(60)
    judged, judged_label = pictures(30, seed=1)
    found = train(gray, label.astype(np.int64), judged, judged_label.astype(np.int64))
    unseen, truth = pictures(20, seed=2)
    probability = found(unseen)
    assert probability.shape == (20, 2)
    assert probability.sum(axis=1) == pytest.approx(np.ones(20))
    assert (probability.argmax(axis=1) == truth).all()


def test_gradients_of_a_vertical_edge_lie_in_one_direction() -> None:
    edge = np.zeros((1, 64, 64), np.uint8)
    edge[:, :, 32:] = 200
    histograms = gradients(edge).reshape(7, 7, 4, 9)
    assert histograms[:, 3, :, 0].max() > 0.4
    assert histograms[..., 1:].max() == pytest.approx(0, abs=1e-6)


def test_table_iv_row_by_row(
    roads: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "compare.json"
    common = [str(roads), "--epochs", "1", "--out", str(out), "--also", f"other={roads}"]
    assert compare.main([*common, "--rows", "kNN"]) == 0
    assert compare.main([*common, "--rows", "kNN;JuncNet, robust", "--resume"]) == 0
    table = json.loads(out.read_text())
    assert [entry["name"] for entry in table["entries"]] == ["kNN", "JuncNet, robust"]
    columns = table["entries"][0]["columns"]
    assert list(columns) == ["unseen sites", "seen sites", "other"]
    assert columns["unseen sites"]["balanced_accuracy"] == 1.0
    text = out.with_suffix(".md").read_text()
    assert "roads, seen sites" in text
    assert "shortened to 12.5 % of 8" in text
    assert "Not trained yet: SVM; 1-CNN, 2-FCN; AlexNet; VGG" in text
    assert str(tmp_path) not in text
    assert out.with_suffix(".png").stat().st_size < 200_000
    assert compare.main([*common, "--seed", "1", "--resume"]) == 2
    assert "another seed" in capsys.readouterr().err
    assert compare.main([*common, "--rows", "Bayes"]) == 2
    told = capsys.readouterr().err
    assert all(name in told for name in NAMES)


def write_folders(folder: Path) -> Path:
    """Write class folders: nobody told their sites."""
    gray, label = pictures(12, seed=3)
    for number, (picture, index) in enumerate(zip(gray, label, strict=True)):
        path = folder / ("none", "junction")[int(index)] / f"{number}.png"
        path.parent.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(path), picture)
    return folder


def test_a_table_goes_on_with_the_same_test_sets_alone(
    roads: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, less = tmp_path / "compare.json", write_roads(tmp_path / "less", n=60)
    common = [str(roads), "--rows", "kNN", "--out", str(out)]
    also = ["--also", f"other={roads}"]
    assert compare.main([*common, *also]) == 0
    for other in ([], ["--also", f"other={less}"], [*also, "--test-limit", "10"]):
        assert compare.main([*common, *other, "--resume"]) == 2
        assert "kNN was tested on other sets" in capsys.readouterr().err
    assert compare.main([*common, *also, "--resume"]) == 0


def test_a_further_set_has_the_trained_classes_in_any_order(
    roads: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    swapped = write_roads(tmp_path / "swapped", classes=("junction", "none"))
    named = write_roads(tmp_path / "named", classes=("none", "fork"))
    out = tmp_path / "compare.json"
    common = [str(roads), "--rows", "kNN", "--out", str(out)]
    assert compare.main([*common, "--also", f"swapped={swapped}"]) == 0
    columns = json.loads(out.read_text())["entries"][0]["columns"]
    assert columns["swapped"]["auc"] == 0.0, "its labels say the contrary"
    assert columns["swapped"]["n"] == 120
    assert compare.main([*common, "--also", f"named={named}"]) == 2
    assert "named: its classes are none, fork" in capsys.readouterr().err


def test_a_set_of_unknown_sites_says_so(roads: Path, tmp_path: Path) -> None:
    out, folders = tmp_path / "compare.json", write_folders(tmp_path / "f")
    wanted = [str(roads), "--rows", "kNN", "--out", str(out), "--also", f"folders={folders}"]
    assert compare.main(wanted) == 0
    assert json.loads(out.read_text())["sites_unknown"] == ["folders"]
    assert "The sites of folders are unknown" in out.with_suffix(".md").read_text()


def test_a_checkpoint_of_other_pictures_makes_no_row(
    roads: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = write_roads(tmp_path / "other", seed=1)
    common = ["--epochs", "0.1", "--rows", "JuncNet, robust"]
    common += ["--checkpoints", str(tmp_path / "ck"), "--out", str(tmp_path / "c.json")]
    assert compare.main([str(roads), *common]) == 0
    assert compare.main([str(roads), *common]) == 0, "the same pictures: it goes on"
    assert compare.main([str(other), *common]) == 2
    assert "another set of pictures" in capsys.readouterr().err


def test_ablation_shows_the_change_to_the_reference(roads: Path, tmp_path: Path) -> None:
    out = tmp_path / "ablate.json"
    rows = "gray and Radon (reference);gray only;32x32"
    wanted = [str(roads), "--epochs", "1", "--limit", "30", "--rows", rows, "--out", str(out)]
    assert ablate.main(wanted) == 0
    entries = json.loads(out.read_text())["entries"]
    assert [entry["name"] for entry in entries] == rows.split(";")
    assert entries[2]["weights"] < entries[0]["weights"]
    assert (
        ", +" in out.with_suffix(".md").read_text() or ", -" in out.with_suffix(".md").read_text()
    )


def test_every_variant_changes_one_thing() -> None:
    base = next(iter(VARIANTS.values())).model_dump()
    for name, variant in list(VARIANTS.items())[1:]:
        changed = [key for key, value in variant.model_dump().items() if value != base[key]]
        assert len(changed) == 1, name


def idx(array: NDArray[np.uint8]) -> bytes:
    """Return an array in MNIST's format."""
    head = struct.pack(f">HBB{array.ndim}I", 0, 8, array.ndim, *array.shape)
    return gzip.compress(head + array.tobytes())


@pytest.fixture
def digits(tmp_path: Path) -> Path:
    """Return a folder like MNIST's with 60 and 20 pictures."""
    folder, rng = tmp_path / "mnist", np.random.default_rng(0)
    folder.mkdir()
    for part, n in (("train", 60), ("t10k", 20)):
        label = (np.arange(n) % 10).astype(np.uint8)
        drawn = rng.integers(0, 50, (n, 28, 28), np.uint8) + 20 * label[:, None, None]
        (folder / f"{part}-images-idx3-ubyte.gz").write_bytes(idx(drawn.astype(np.uint8)))
        (folder / f"{part}-labels-idx1-ubyte.gz").write_bytes(idx(label))
    return folder


def test_benchmark_says_what_was_shortened_and_keeps_other_rows(
    digits: Path, tmp_path: Path
) -> None:
    out = tmp_path / "benchmark.json"
    common = ["mnist", str(digits), "--out", str(out), "--checkpoints", str(tmp_path / "c")]
    assert benchmark.main([*common, "--recipe", "tuned", "--epochs", "1"]) == 0
    assert benchmark.main([*common, "--recipe", "paper", "--epochs", "1"]) == 0
    rows = json.loads(out.read_text())["rows"]
    assert [row["name"] for row in rows] == ["paper", "tuned"]
    assert (rows[0]["n_train"], rows[0]["n_held_out"], rows[0]["n_test"]) == (54, 6, 20)
    text = out.with_suffix(".md").read_text()
    assert "shortened to 0.5 % of 200" in text
    assert "missed by" in text
    assert out.with_suffix(".png").stat().st_size < 200_000
    assert len(list((tmp_path / "c").glob("*.pt"))) == 2


def test_a_checkpoint_of_other_variations_is_refused(
    digits: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    wanted = ["mnist", str(digits), "--out", str(tmp_path / "b.json"), "--recipe", "tuned"]
    wanted += ["--epochs", "1", "--checkpoints", str(tmp_path / "c")]
    assert benchmark.main(wanted) == 0
    assert "shifted up to 12 % of the side" in (tmp_path / "b.md").read_text()
    monkeypatch.setattr(small_pictures, "SHIFT", 0.1)
    assert benchmark.main(wanted) == 2
    assert "another variation: shifted up to 12 % of the side" in capsys.readouterr().err


def test_files_that_are_not_mnist_are_named(
    digits: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = digits / "t10k-labels-idx1-ubyte.gz"
    path.write_bytes(gzip.compress(b"\0" * 40))
    with pytest.raises(ImageSetError, match="t10k-labels"):
        load_mnist(digits)
    path.unlink()
    assert benchmark.main(["mnist", str(digits), "--out", str(tmp_path / "o.json")]) == 2
    assert "t10k-labels-idx1-ubyte" in capsys.readouterr().err


def test_jpeg_copies_of_cifar_are_called_so(tmp_path: Path) -> None:
    red = np.zeros((32, 32, 3), np.uint8)
    red[..., 2] = 255  # OpenCV writes blue first
    data = cv2.imencode(".jpg", red)[1].ravel()
    content, offsets = np.concatenate([data, data]), np.array([0, len(data), 2 * len(data)])
    part = {"bytes": content, "offsets": offsets, "y": np.array([3, 4], np.uint8)}
    arrays = {f"{name}_{k}": v for name in ("train", "test") for k, v in part.items()}
    np.savez(tmp_path / "c.npz", allow_pickle=False, **arrays)
    images = load_cifar10(tmp_path / "c.npz")
    assert images.name == "JPEG CIFAR-10"
    assert images.test_label.tolist() == [3, 4]
    assert images.train[0, 32, 32, 0] > 240
    assert images.train[0, 32, 32, 2] < 20
    (tmp_path / "text").write_text("nothing")
    with pytest.raises(ImageSetError, match="neither"):
        load_cifar10(tmp_path / "text")


def test_grey_pictures_in_colour_give_the_grey_features() -> None:
    gray, _ = pictures(3)
    preprocessing = Preprocessing(standardisation="per_image")
    colour = ColourExtractor(preprocessing).batch(np.repeat(gray[..., None], 3, axis=3))
    plain = Extractor(preprocessing).batch(gray)
    assert colour.shape == (3, 4, 64, 64)
    for k in range(3):
        np.testing.assert_allclose(colour[:, k], plain[:, 0], atol=1e-5)
    np.testing.assert_allclose(colour[:, 3], plain[:, 1], atol=1e-5)


def test_variations_keep_size_and_are_none_at_strength_zero() -> None:
    gray, _ = pictures(4)
    same = varied(gray, np.random.default_rng(0), 0.0, mirror=False)
    assert (same == gray).all()
    other = varied(gray, np.random.default_rng(0), 0.5, mirror=True)
    assert other.shape == gray.shape
    assert (other != gray).mean() > 0.5
    again = varied(gray, np.random.default_rng(0), 0.5, mirror=True)
    assert (again == other).all()
