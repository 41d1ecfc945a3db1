"""Training: learns what can be learnt, repeats by seed, and resumes as if never interrupted."""

# Torch leaves these of its own members without types.
# pyright: reportUnknownMemberType=false

import dataclasses
import json
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

pytest.importorskip("torch", reason="torch is not installed: deploy/test --with-train")

import torch
from torch import nn

from juncnet.features import Extractor, Preprocessing
from juncnet.learning.augment import mirror, vary
from juncnet.learning.datasets import DatasetError, DatasetInfo, Row, open_dataset, write_dataset
from juncnet.learning.fit import CheckpointError, DivergedError, Trainer, cross_entropy, predict
from juncnet.learning.pictures import Pictures
from juncnet.learning.recipes import PAPER, PRESETS, Recipe
from juncnet.learning.train import Order, divide, recipe_from, train
from juncnet.learning.weights import WeightsError
from juncnet.network import build
from juncnet_services.cli import curve
from juncnet_services.cli import train as command

GRAY = Preprocessing(channels=("gray",), standardisation="per_image")
QUICK = Recipe(preprocessing=GRAY, epochs=7, batch=32, rate=4e-3, average=0.9, bfloat16=False)


def cross(n: int, seed: int) -> tuple[NDArray[np.uint8], NDArray[np.int64]]:
    """Return pictures of noise and labels; in those of junctions there is a bright cross."""
    rng = np.random.default_rng(seed)
    gray = rng.integers(60, 120, (n, 64, 64), dtype=np.uint8)
    label = np.arange(n) % 2
    gray[label == 1, 28:36, :] = 220
    gray[label == 1, :, 28:36] = 220
    return gray, label


def pictures(n: int, seed: int, masked: bool = True) -> Pictures:
    gray, label = cross(n, seed)
    mask = np.zeros((n, 32, 32), np.uint8)
    mask[label == 1, 14:18] = 2
    target = np.eye(2, dtype=np.float32)[label]
    return Pictures(gray, target, label, mask, np.full(n, masked))


def trainer(
    recipe: Recipe = QUICK,
    seed: int = 3,
    n: int = 96,
    seen: tuple[int, int] = (0, 1),
    start: int | None = None,
) -> Trainer:
    """Return a training; `seen` are the seeds of its two parts, `start` that of its weights."""
    torch.manual_seed(seed if start is None else start)
    network = build(recipe.architecture, len(recipe.preprocessing.channels))
    extractor = Extractor(recipe.preprocessing)
    own, judged = pictures(n, seen[0]), pictures(32, seen[1])
    return Trainer(network, own, judged, recipe, seed, extractor)


def weights(t: Trainer) -> np.ndarray:
    return np.concatenate([v.numpy().ravel() for v in t.averaged.values()])


def test_training_learns_and_repeats_by_seed() -> None:
    runs = [trainer(), trainer()]
    assert all(run.run() for run in runs)
    np.testing.assert_array_equal(weights(runs[0]), weights(runs[1]))
    assert runs[0].curve == runs[1].curve
    assert runs[0].curve[-1].balanced_accuracy == 1.0
    other = trainer(seed=4)
    other.run()
    assert not np.array_equal(weights(other), weights(runs[0]))


@pytest.mark.parametrize("stops", [(1,), (2, 5)])
def test_an_interrupted_training_ends_as_an_uninterrupted_one(
    stops: Sequence[int], tmp_path: Path
) -> None:
    whole = trainer(QUICK.model_copy(update={"epochs": 2}))
    whole.run()
    path = tmp_path / "c.checkpoint"
    for at in stops:
        part = trainer(QUICK.model_copy(update={"epochs": 2}))
        if path.exists():
            part.resume(path)
        assert not part.run(path, stop=lambda part=part, at=at: part.step >= at)
        assert part.step == at
    last = trainer(QUICK.model_copy(update={"epochs": 2}))
    last.resume(path)
    assert last.run(path)
    np.testing.assert_array_equal(weights(last), weights(whole))
    assert last.curve == whole.curve


def test_a_curve_s_losses_are_means_the_last_one_s_too() -> None:
    still = {"rate": 1e-9, "mask_weight": 0, "augmentation": 0, "dropout": 0}
    t = trainer(QUICK.model_copy(update=still | {"epochs": 15}))
    t.run()
    seen = [point.samples // QUICK.batch for point in t.curve]
    assert seen[-2:] == [44, 45]
    loss = [point.loss for point in t.curve]
    np.testing.assert_allclose(loss, loss[0], rtol=0.1)


def test_the_best_weights_are_kept_where_that_is_wanted() -> None:
    recipe = QUICK.model_copy(update={"keep_best": True, "rate": 1.0, "epochs": 2})
    good = trainer()
    good.run()
    torch.manual_seed(0)
    network = build("robust", 1)
    network.load_state_dict(good.averaged)
    extractor = Extractor(GRAY)
    spoilt = Trainer(network, pictures(96, 0), pictures(32, 1), recipe, 0, extractor)
    assert spoilt.run()
    assert spoilt.curve[0].samples == 0
    for name, value in network.state_dict().items():
        assert torch.equal(value, good.averaged[name]), name


def test_a_diverged_training_says_so_at_once() -> None:
    with pytest.raises(DivergedError, match="lower rate than 1e\\+30"):
        trainer(QUICK.model_copy(update={"rate": 1e30, "schedule": "constant"})).run()


class Bright(nn.Module):
    """Calls bright pictures junctions."""

    def __init__(self) -> None:
        super().__init__()
        self.factor = nn.Parameter(torch.ones(1))

    def forward(self, features: torch.Tensor) -> torch.Tensor:
        bright = self.factor * features.mean(dim=(1, 2, 3))
        return torch.stack([-bright, bright], dim=1)


@pytest.mark.parametrize(
    ("label", "auc"), [([0, 1, -1], 1.0), ([1, 0, -1], 0.0), ([0, 0, -1], None), ([-1] * 3, None)]
)
def test_what_is_watched_is_none_and_junctions_without_the_band(
    label: Sequence[int], auc: float | None
) -> None:
    shades = np.array([50, 100, 200], np.uint8)
    gray = np.tile(shades[:, None, None], (1, 64, 64))
    watched = dataclasses.replace(pictures(3, 0), gray=gray, label=np.array(label))
    plain = Extractor(Preprocessing(channels=("gray",)))
    recipe = QUICK.model_copy(update={"epochs": 0.1})
    t = Trainer(Bright(), pictures(8, 0), pictures(8, 1), recipe, 0, plain, watched)
    t.run()
    assert t.curve[-1].watched_auc == auc


def test_a_checkpoint_of_another_training_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "c.checkpoint"
    trainer().save(path)
    with pytest.raises(CheckpointError, match="another seed: 3 instead of 4"):
        trainer(seed=4).resume(path)
    with pytest.raises(CheckpointError, match="another number of pictures"):
        trainer(n=64).resume(path)
    for name, other in (
        ("set of pictures", trainer(seen=(2, 1))),
        ("validation part", trainer(seen=(0, 2))),
        ("start", trainer(start=5)),
    ):
        with pytest.raises(CheckpointError, match=f"another {name}"):
            other.resume(path)
    path.write_bytes(b"nothing")
    with pytest.raises(CheckpointError, match="cannot be read"):
        trainer().resume(path)


def test_a_checkpoint_that_does_not_name_its_pictures_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "c.checkpoint"
    trainer().save(path)
    state = torch.load(path, weights_only=True)
    del state["what"]["set of pictures"]
    torch.save(state, path)
    with pytest.raises(CheckpointError, match="an earlier version wrote it"):
        trainer().resume(path)


def test_every_epoch_sees_every_picture_once() -> None:
    t = trainer(QUICK.model_copy(update={"batch": 50}), n=60)
    seen = list[int]()
    for step in range(6):
        t.step = step
        seen += t.chosen().tolist()
    for epoch in range(5):
        assert sorted(seen[60 * epoch : 60 * epoch + 60]) == list(range(60))


def test_the_rate_of_one_cycle_rises_and_falls_and_the_paper_s_stays() -> None:
    t = trainer()
    rates: list[float] = []
    for step in range(t.steps):
        t.step = step
        rates.append(t.rate())
    assert max(rates) == pytest.approx(QUICK.rate, rel=0.05)
    assert rates.index(max(rates)) <= 0.15 * t.steps
    assert rates[-1] < 0.01 * QUICK.rate
    assert PAPER.model_dump(include={"optimiser", "rate", "epochs", "batch", "schedule"}) == {
        "optimiser": "adam",
        "rate": 1e-5,
        "epochs": 200.0,
        "batch": 30,
        "schedule": "constant",
    }


def test_weights_of_classes_leave_a_probability_where_it_is() -> None:
    weight = torch.tensor([0.5, 3.0])
    for target in (0.3, 0.5):
        logit = torch.zeros(1, requires_grad=True)
        wanted = torch.tensor([[1 - target, target]])
        for _ in range(400):
            loss = cross_entropy(torch.stack([torch.zeros(1), logit], 1), wanted, weight)
            loss.backward()
            with torch.no_grad():
                logit -= logit.grad if logit.grad is not None else 0
            logit.grad = None
        assert torch.sigmoid(logit).item() == pytest.approx(target, abs=0.01)


def test_augmentation_keeps_what_is_there() -> None:
    gray, _ = cross(16, 0)
    rng = np.random.default_rng(0)
    masks = np.zeros((16, 32, 32), np.uint8)
    gray[:, :, :8], masks[:, :, :4] = 255, 1
    mirrored, both = mirror(gray, masks, rng)
    assert both is not None
    left = (mirrored[:, :, 0] == 255).all(axis=1)
    assert 0 < left.sum() < 16
    np.testing.assert_array_equal(both[:, 0, 0] == 1, left)
    varied = vary(gray, rng, 1.0)
    assert varied.shape == gray.shape
    assert varied.dtype == np.uint8
    assert not np.array_equal(varied, gray)
    assert vary(gray, rng, 0.0) is gray


def write(
    folder: Path, n: int = 48, sites: int = 6, classes: tuple[str, str] | None = None
) -> Path:
    """Write a dataset of pictures larger than the network's."""
    names = classes or ("none", "junction")
    gray, label = cross(n, 5)
    folder.mkdir(parents=True)
    rows: list[Row] = []
    for i in range(n):
        picture = np.asarray(gray[i], np.uint8)
        cv2.imwrite(str(folder / f"{i}.png"), cv2.resize(picture, (160, 90)))
        site = f"site{(i // 2) % sites}"
        rows.append(Row(f"{i}.png", names[int(label[i])], f"{site}-a", site))
    write_dataset(folder, DatasetInfo(classes=names), rows)
    return folder


def test_parts_are_whole_sites(tmp_path: Path) -> None:
    parts = divide(open_dataset(write(tmp_path / "d")), 0)
    assert not set(parts.training.site) & set(parts.validation.site)
    assert len(parts.training) + len(parts.validation) == 48
    assert parts.how == "1 of 6 sites held out"
    alone = divide(open_dataset(write(tmp_path / "e", sites=1)), 0)
    assert len(alone.training) == len(alone.validation) == 48
    assert "nothing held out" in alone.how


def test_pictures_whose_site_nobody_told_are_held_out_by_clip(tmp_path: Path) -> None:
    data = open_dataset(write(tmp_path / "d"))
    data.site[:] = ""
    parts = divide(data, 0)
    assert parts.how == "1 of 6 clips and sites held out"
    assert not set(parts.training.clip) & set(parts.validation.clip)


def test_fine_tuning_starts_from_the_model(tmp_path: Path) -> None:
    data = [open_dataset(write(tmp_path / "d"))]
    first = Order(QUICK.model_copy(update={"epochs": 20}), 0, "first", tmp_path / "first.onnx")
    assert train(data, first).finished
    recipe = recipe_from(PRESETS["robust"], first.out)
    assert recipe.preprocessing == GRAY
    assert recipe.rate == pytest.approx(0.2 * PRESETS["robust"].rate)
    little = recipe.model_copy(update={"epochs": 0.1, "bfloat16": False})
    second = Order(little, 0, "second", tmp_path / "second.onnx", start=first.out)
    assert train(data, second).curve[-1].balanced_accuracy == 1.0
    with pytest.raises(WeightsError, match="name a preset of the same one"):
        recipe_from(PRESETS["tuned"], first.out)


def test_a_start_that_is_wrong_makes_more_pictures(tmp_path: Path) -> None:
    data = [open_dataset(write(tmp_path / "d"))]
    ignorant = Order(QUICK.model_copy(update={"epochs": 0.1}), 0, "none", tmp_path / "none.onnx")
    plain = train(data, ignorant).pictures
    recipe = QUICK.model_copy(update={"epochs": 0.1, "repeat_wrong": 3})
    after = Order(recipe, 0, "after", tmp_path / "after.onnx", start=ignorant.out)
    assert train(data, after).pictures > plain
    assert "what the start got wrong 3 times" in recipe.describe()


def test_what_the_start_gets_wrong_is_repeated() -> None:
    given = pictures(4, 0)
    unsure = np.array([[0.7, 0.3], [0.5, 0.5], [0.3, 0.7], [0.1, 0.9]])
    more = given.with_wrong_repeated(unsure, 3)
    # Labels are none, junction, none, junction: the second and the third are wrong or unsure.
    np.testing.assert_array_equal(more.gray, given.gray[[0, 1, 1, 1, 2, 2, 2, 3]])
    np.testing.assert_array_equal(more.label, [0, 1, 1, 1, 0, 0, 0, 1])
    ramp = dataclasses.replace(given, target=np.full((4, 2), 0.5, np.float32))
    assert len(ramp.with_wrong_repeated(unsure, 3)) == 4


def test_a_dataset_without_plain_road_is_refused(tmp_path: Path) -> None:
    data = [open_dataset(write(tmp_path / "d", classes=("one", "two")))]
    with pytest.raises(DatasetError, match="the first class must be none"):
        train(data, Order(QUICK, 0, "m", tmp_path / "m.onnx"))


def test_the_command_trains_and_writes_model_card_and_curve(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, out = write(tmp_path / "d"), tmp_path / "mine.onnx"
    arguments = [str(folder), "--out", str(out), "--epochs", "2", "--threads", "1"]
    arguments += ["--watch", str(folder)]
    assert command.main(arguments) == 0
    assert "1 of 6 sites held out" in capsys.readouterr().out
    first = out.with_suffix(".json").rename(tmp_path / "first.json")
    assert command.main([*arguments, "--from", str(out), "--epochs", "1"]) == 0
    data = json.loads(out.with_suffix(".json").read_text())
    assert data["command"].startswith("juncnet train d --out mine.onnx")
    assert data["curve"][-1]["samples"] > 0
    assert 0 <= data["curve"][-1]["watched_auc"] <= 1
    assert "1 of 6 sites held out" in out.with_suffix(".md").read_text()
    assert not out.with_suffix(".checkpoint").exists()
    picture = tmp_path / "auc.png"
    joined = [str(first), str(out.with_suffix(".json")), "--out", str(picture)]
    assert curve.main(joined) == 0
    before = json.loads(first.read_text())["curve"][-1]["samples"]
    told = f"after {before + data['curve'][-1]['samples']} pictures"
    assert told in capsys.readouterr().out
    assert picture.stat().st_size < 200_000
    stretches = json.loads(picture.with_suffix(".json").read_text())["stretches"]
    assert [stretch["name"] for stretch in stretches] == ["first", "mine"]


def test_a_curve_of_nothing_watched_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    report, out = tmp_path / "mine.json", str(tmp_path / "auc.png")
    for text, said in (
        ("[]", "no report of juncnet train"),
        ('{"command": "", "curve": []}', "nothing was watched"),
        ('{"command": "", "curve": [{"samples": 1}]}', "nothing was watched"),
    ):
        report.write_text(text)
        assert curve.main([str(report), "--out", out]) == 2
        assert said in capsys.readouterr().err
    report.write_text('{"command": "", "curve": [{"samples": 1, "watched_auc": 0.5}]}')
    assert curve.main([str(report), "--out", str(report.with_suffix(".png"))]) == 2
    assert "would replace" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["nowhere"], "no such folder"),
        (["d", "--epochs", "-1"], "epochs"),
        (["d", "--from", "gone.onnx"], "gone.onnx"),
        (["d", "--repeat-wrong", "3"], "--from MODEL"),
        (["d", "--augmentation", "3"], "augmentation"),
    ],
)
def test_bad_arguments_end_with_2(
    arguments: list[str],
    said: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    write(tmp_path / "d", 8)
    monkeypatch.chdir(tmp_path)
    assert command.main(arguments) == 2
    assert said in capsys.readouterr().err


def test_predictions_are_probabilities() -> None:
    answer = predict(build("robust", 1), cross(3, 0)[0], Extractor(GRAY))
    np.testing.assert_allclose(answer.sum(axis=1), 1, atol=1e-6)
