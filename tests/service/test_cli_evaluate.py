"""`juncnet evaluate` with the shipped model on a few pictures."""

import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

from juncnet.assets import asset
from juncnet.learning.datasets import DatasetInfo, Row, write_dataset
from juncnet_services.cli.evaluate import main


@pytest.fixture
def data(tmp_path: Path) -> Path:
    """Return a dataset of 24 pictures: of plain noise and of noise with a bar across."""
    folder, rng = tmp_path / "roads", np.random.default_rng(0)
    (folder / "p").mkdir(parents=True)
    rows: list[Row] = []
    for i in range(24):
        picture = rng.integers(0, 80, (72, 96), np.uint8)
        label = "junction" if i % 2 else "none"
        if i % 2:
            picture[30:50] += 120
        cv2.imwrite(str(folder / f"p/{i}.png"), picture)
        split = "test" if i >= 12 else "train"
        rows.append(Row(f"p/{i}.png", label, f"clip{i // 6}", f"site{i // 4}", split))
    write_dataset(folder, DatasetInfo(classes=("junction", "none"), made_by="a test"), rows)
    return folder


def test_all_figures_are_one_object(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "result.json"
    assert main(["juncnet", str(data), "--json", "--out", str(out)]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed == json.loads(out.read_text())
    assert (printed["n"], printed["sites"], printed["split"]) == (12, 3, "test")
    assert printed["protocol"] == "unseen sites"
    assert sum(map(sum, printed["confusion"])) == 12
    assert 0 <= printed["balanced_accuracy"] <= 1
    assert set(printed["groups"]) == {"clip2", "clip3"}
    assert printed["latency"]["total_p50_ms"] > 0
    assert str(tmp_path) not in out.read_text()
    for name in ("result.png", "result-mistakes.png", "result-fig5.png"):
        assert 2000 < (tmp_path / name).stat().st_size < 200_000
        assert name in out.with_suffix(".md").read_text()


def test_a_split_that_shares_sites_is_called_so(data: Path, tmp_path: Path) -> None:
    table = data / "samples.csv"
    table.write_text(table.read_text().replace("site5", "site0"))
    out = tmp_path / "result.json"
    assert main(["juncnet", str(data), "--pictures", "none", "--out", str(out)]) == 0
    assert json.loads(out.read_text())["protocol"] == "seen sites"
    assert "**seen sites**" in out.with_suffix(".md").read_text()


def test_classes_in_another_order_mean_the_same(data: Path, tmp_path: Path) -> None:
    first, second = tmp_path / "1.json", tmp_path / "2.json"
    assert main(["juncnet", str(data), "--pictures", "none", "--out", str(first)]) == 0
    info = data / "dataset.json"
    swapped = json.loads(info.read_text()) | {"classes": ["none", "junction"]}
    info.write_text(json.dumps(swapped))
    assert main(["juncnet", str(data), "--pictures", "none", "--out", str(second)]) == 0
    figures = [json.loads(path.read_text()) for path in (first, second)]
    assert figures[0]["confusion"] == figures[1]["confusion"]
    assert figures[0]["auc"] == figures[1]["auc"]


def test_told_apart_junctions_count_as_junctions(data: Path, tmp_path: Path) -> None:
    out = tmp_path / "result.json"
    info, table = data / "dataset.json", data / "samples.csv"
    info.write_text(info.read_text().replace('"junction",', '"first", "second",'))
    table.write_text(table.read_text().replace("3.png,junction", "3.png,first"))
    table.write_text(table.read_text().replace(",junction", ",second"))
    assert (
        main(["juncnet", str(data), "--pictures", "none", "--split", "all", "--out", str(out)]) == 0
    )
    figures = json.loads(out.read_text())
    assert figures["classes"] == ["none", "junction"]
    assert figures["per_class"]["junction"]["n"] == 12


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (["--split", "validation"], "the data have test, train, all"),
        (["--split", "nonsense"], "the data have test, train, all"),
    ],
)
def test_wrong_options_are_named(
    data: Path, arguments: list[str], reason: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["juncnet", str(data), *arguments]) == 2
    assert reason in capsys.readouterr().err


def test_no_model_no_data(data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    broken = tmp_path / "broken.onnx"
    broken.write_bytes(b"nothing")
    assert main([str(broken), str(data)]) == 2
    assert "not a valid ONNX model" in capsys.readouterr().err
    assert main(["juncnet", str(tmp_path / "nowhere")]) == 2
    assert "no such folder" in capsys.readouterr().err
    assert main(["nosuchmodel", str(data)]) == 2
    assert "nosuchmodel" in capsys.readouterr().err


def test_a_model_file_is_judged_wherever_it_lies(data: Path, tmp_path: Path) -> None:
    copy, out = tmp_path / "mine.onnx", tmp_path / "result.json"
    shutil.copy(asset("models/juncnet.onnx"), copy)
    assert main([str(copy), str(data), "--pictures", "none", "--out", str(out)]) == 0
    assert "juncnet evaluate mine roads" in out.with_suffix(".md").read_text()


def test_scores_are_put_into_the_card_once_a_set(data: Path, tmp_path: Path) -> None:
    copy, card = tmp_path / "mine.onnx", tmp_path / "mine.md"
    shutil.copy(asset("models/juncnet.onnx"), copy)
    card.write_text("# mine\n\nAs it was.\n")
    common = [
        str(copy),
        str(data),
        "--pictures",
        "none",
        "--card",
        "--out",
        str(tmp_path / "o.json"),
    ]
    assert main([*common, "--name", "first set"]) == 0
    with card.open("a") as file:
        file.write("\n| a table | of the reader's own |\n|---|---|\n| that | stays |\n")
    for name in ("second set", "first set"):
        assert main([*common, "--name", name]) == 0
    text = card.read_text()
    rows = [line.split("|")[1].strip() for line in text.splitlines() if line.startswith("|")]
    assert rows[2:5] == ["first set", "second set", "a table"]
    assert text.startswith("# mine\n\nAs it was.\n")
    assert (text.count("| first set |"), text.count("| second set |")) == (1, 1)
    assert text.count("## Scores") == 1
