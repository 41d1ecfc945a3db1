"""The packages that users begin with: what is written works as it is."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from juncnet_services.cli import check_follower
from juncnet_services.cli.kits import main
from juncnet_services.kits import write_kit


def test_the_kits_own_tests_pass(tmp_path: Path) -> None:
    assert main(["my_own", "--into", str(tmp_path)]) == 0
    package = tmp_path / "my_own"
    text = "\n".join(path.read_text() for path in package.rglob("*") if path.is_file())
    assert "{name}" not in text
    assert "{class_name}" not in text
    environment = os.environ | {"PYTHONPATH": str(package)}
    words = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", str(package)]
    done = subprocess.run(words, env=environment, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "passed" in done.stdout


def test_nothing_is_overwritten(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_kit("follower", "mine", tmp_path)
    assert main(["mine", "--into", str(tmp_path)]) == 2
    assert "is there already" in capsys.readouterr().err


def test_a_name_that_is_no_package_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["My-Follower"]) == 2
    assert "small letters" in capsys.readouterr().err


def test_a_follower_that_is_not_there_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    assert check_follower.main(["absent_module:Nobody", "--seeds", "1"]) == 2
    assert "absent_module" in capsys.readouterr().err


@pytest.mark.full
def test_a_kits_follower_is_scored_beside_the_built_in_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    write_kit("follower", "checked", tmp_path)
    monkeypatch.setattr(sys, "path", [str(tmp_path / "checked"), *sys.path])
    code = check_follower.main(["checked.follower:Checked", "--seeds", "1"])
    out = capsys.readouterr().out
    assert code in (0, 1)
    assert "checked.follower:Checked" in out
    assert "VisionFollower" in out
