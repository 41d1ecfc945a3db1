"""From datasets to a model file: parts, starts, what is refused, and the command."""

# Torch leaves these of its own members without types.
# pyright: reportUnknownMemberType=false

import json
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("torch", reason="torch is not installed: deploy/test --with-train")

from pydantic import ValidationError

from crosses import GRAY, QUICK, write
from juncnet.assets import asset_path
from juncnet.learning.datasets import DatasetError, open_dataset
from juncnet.learning.fit import CheckpointError
from juncnet.learning.recipes import PRESETS, Recipe
from juncnet.learning.train import Order, divide, recipe_from, train
from juncnet.learning.weights import WeightsError
from juncnet_services.cli import curve
from juncnet_services.cli import train as command


def test_parts_are_whole_sites(tmp_path: Path) -> None:
    parts = divide(open_dataset(write(tmp_path / "d")), 0)
    assert not set(parts.training.site) & set(parts.validation.site)
    assert len(parts.training) + len(parts.validation) == 48
    assert parts.how == "1 of 6 sites held out"
    alone = divide(open_dataset(write(tmp_path / "e", sites=1)), 0)
    assert len(alone.training) == len(alone.validation) == 48
    assert "nothing held out" in alone.how


@pytest.mark.parametrize("split", ["test", "validation"])
def test_a_dataset_without_anything_to_train_on_is_refused(split: str, tmp_path: Path) -> None:
    data = open_dataset(write(tmp_path / "d", 8))
    object.__setattr__(data, "split", np.full(len(data), split))
    with pytest.raises(DatasetError, match="no picture to train on"):
        divide(data, 0)


def test_pictures_that_teach_nothing_are_refused(tmp_path: Path) -> None:
    data = open_dataset(write(tmp_path / "d", 8))
    data.target[:] = np.nan
    with pytest.raises(DatasetError, match="no picture says what it shows"):
        train([data], Order(QUICK, 0, "m", tmp_path / "m.onnx"))


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
    assert not recipe.mirror_mean
    assert recipe.rate == pytest.approx(0.2 * PRESETS["robust"].rate)
    little = recipe.model_copy(update={"epochs": 0.1, "bfloat16": False})
    second = Order(little, 0, "second", tmp_path / "second.onnx", start=first.out)
    assert train(data, second).curve[-1].balanced_accuracy == 1.0
    with pytest.raises(WeightsError, match="name a preset of the same one"):
        recipe_from(PRESETS["tuned"], first.out)


def test_going_on_from_a_model_that_answers_a_mean_keeps_that(tmp_path: Path) -> None:
    assert recipe_from(PRESETS["robust"], asset_path("juncnet", "models", ".onnx")).mirror_mean
    data = [open_dataset(write(tmp_path / "d"))]
    recipe = QUICK.model_copy(update={"epochs": 0.1, "mirror_mean": True})
    order = Order(recipe, 0, "m", tmp_path / "m.onnx")
    assert train(data, order).finished
    assert recipe_from(PRESETS["robust"], order.out).mirror_mean
    with pytest.raises(ValidationError, match="only the architecture robust"):
        Recipe.model_validate(PRESETS["tuned"].model_dump() | {"mirror_mean": True})


def test_a_start_that_is_wrong_makes_more_pictures(tmp_path: Path) -> None:
    data = [open_dataset(write(tmp_path / "d"))]
    ignorant = Order(QUICK.model_copy(update={"epochs": 0.1}), 0, "none", tmp_path / "none.onnx")
    plain = train(data, ignorant).pictures
    recipe = QUICK.model_copy(update={"epochs": 0.1, "repeat_wrong": 3})
    after = Order(recipe, 0, "after", tmp_path / "after.onnx", start=ignorant.out)
    judged: list[tuple[int, int]] = []
    outcome = train(data, after, judging=lambda done, of: judged.append((done, of)))
    assert outcome.pictures > plain
    assert judged[-1] == (plain, plain)
    assert "what the start got wrong 3 times" in recipe.describe()


def test_a_training_under_way_is_not_begun_anew_unasked(tmp_path: Path) -> None:
    data, order = [open_dataset(write(tmp_path / "d"))], Order(QUICK, 0, "m", tmp_path / "m.onnx")
    assert not train(data, order, stop=lambda: True).finished
    with pytest.raises(CheckpointError, match=r"m\.checkpoint: a training that was not finished"):
        train(data, order)
    assert train(data, order, resume=True).finished
    assert train(data, order).finished


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
    assert "| 0 | - |" in out.with_suffix(".md").read_text(), "no step, no loss"
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
        (["d", "--int8", "--seed", "0", "--augmentation", "-1"], "augmentation: Input should"),
        (["d", "--preset", "tuned", "--mirror-mean"], "only the architecture robust"),
        (["d", "--from", "gone.onnx"], "gone.onnx"),
        (["d", "--repeat-wrong", "3"], "--from MODEL"),
        (["d", "--augmentation", "3"], "augmentation"),
        (["d", "--out", "my model.onnx"], "another name with --name"),
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
