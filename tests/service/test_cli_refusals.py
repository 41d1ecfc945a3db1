"""Commands that are given what cannot work say so in words, with 2, before they begin."""

import importlib
from pathlib import Path

import pytest

REFUSED = [
    ("demo", ["--for", "-3"], "-3: give a number above 0"),
    ("demo", ["--seed", "-1"], "-1: give a whole number, at least 0"),
    ("demo", ["--mission", "/nowhere/own.toml"], "/nowhere/own.toml: there is no such file"),
    ("demo", ["--mission", "{}/own.json"], "own.json: turns.0.at: Input should be greater than"),
    ("dashboard", ["--port", "65536"], "65536: give a whole number, 0 to 65535"),
    ("soak", ["--passes", "0", "--out", "{}/soak.json"], "0: give a whole number, at least 1"),
    ("soak", ["--out", "{}/own.json/soak.json"], "soak.json cannot be written"),
    ("flights", ["--seeds", "1", "--simulated", "--out", "{}"], "ends in .json"),
    ("record", ["--split-mb", "0"], "0: give a whole number, at least 1"),
    ("dataset.film", ["--seed", "1", "--out", "{}/f", "--fps", "0"], "at least 1"),
    ("dataset.film", ["--seed", "1", "--out", "{}/f", "--junctions", "-1"], "at least 0"),
    ("dataset.film", ["--seed", "1", "--out", "{}/f", "--palette", "no"], "'no' is none of"),
    ("dataset.film", ["--seed", "1", "--out", "{}/f", "--height", "37"], "film: height: Input"),
    ("train", ["{}", "--epochs", "-1"], "-1: give a number above 0"),
    ("train", ["{}", "--out", "{}/m.json"], "m.json: give a file that ends in .onnx"),
    ("evaluate", ["m", "{}", "--out", "{}/m.md"], "m.md: give a file that ends in .json"),
    ("compare", ["{}", "--limit", "0"], "0: give a whole number, at least 2"),
    ("bench", ["nope"], "usage: juncnet bench NAME"),
    ("dataset.synthesise", ["{}", "--pictures", "10"], "has other files in it"),
]


@pytest.mark.parametrize(("command", "words", "said"), REFUSED)
def test_what_cannot_work_is_refused_in_words(
    command: str,
    words: list[str],
    said: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    if command == "dataset.synthesise":
        pytest.importorskip("torch")
    (tmp_path / "own.json").write_text(
        '{"name": "own", "turns": [{"at": 0, "turn": "left"}], "finish_after": 1}'
    )
    main = importlib.import_module(f"juncnet_services.cli.{command}").main
    try:
        code = main([word.format(tmp_path) for word in words])
    except SystemExit as error:  # argparse's
        code = error.code
    assert code == 2
    assert said in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["own.json"]
