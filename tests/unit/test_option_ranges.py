"""Options have a range, and a result has a place, before the work begins."""

import argparse
import os
from pathlib import Path

import pytest

from juncnet.assets import asset_path
from juncnet_services.cli.ranges import keep_earlier, make_room_for, port, positive, whole


@pytest.mark.parametrize("text", ["0", "-3", "inf", "nan", "x", ""])
def test_what_is_no_number_above_0_is_refused(text: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError, match="give a number above 0"):
        positive(text)


@pytest.mark.parametrize("text", ["1", "7", "3.5", "x", "nan"])
def test_what_is_no_whole_number_of_the_range_is_refused(text: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError, match="2 to 6"):
        whole(2, 6)(text)


def test_the_ends_of_a_range_belong_to_it() -> None:
    assert [whole(2, 6)("2"), whole(2, 6)("6"), whole(1)("1"), port("0")] == [2, 6, 1, 0]
    assert positive("0.1") == 0.1


def test_a_result_that_cannot_be_written_is_refused_beforehand(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    make_room_for(tmp_path / "new" / "result.json")
    assert not list((tmp_path / "new").iterdir())
    for out in (tmp_path / "file" / "result.json", tmp_path):
        with pytest.raises(ValueError, match="--out"):
            make_room_for(out)


def test_an_earlier_result_is_kept_beside_the_new_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "flights.json"
    keep_earlier(out)
    assert not list(tmp_path.iterdir())
    out.write_text("hours")
    os.utime(out, (0, 0))
    keep_earlier(out)
    assert (tmp_path / "flights-19700101T000000Z.json").read_text() == "hours"
    assert not out.exists()
    assert "--resume" in capsys.readouterr().err


def test_of_an_unknown_name_only_files_of_its_kind_are_told() -> None:
    with pytest.raises(FileNotFoundError, match=r"juncnet\.onnx") as unknown:
        asset_path("nope", "models", ".onnx")
    assert ".png" not in str(unknown.value)
    with pytest.raises(FileNotFoundError, match=r"^/nowhere/own.toml: there is no such file$"):
        asset_path(Path("/nowhere/own.toml"), "missions", ".toml")
