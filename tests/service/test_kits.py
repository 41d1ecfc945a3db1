"""The packages that users begin with: what is written works as it is."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from juncnet_services.cli import check_follower, check_vehicle
from juncnet_services.cli.kits import main
from juncnet_services.command_output.vehicles.log import LogVehicle
from juncnet_services.kits import write_kit


@pytest.mark.parametrize("kit", ["follower", "vehicle"])
def test_the_kits_own_tests_pass(kit: str, tmp_path: Path) -> None:
    assert main([f"new-{kit}", "my_own", "--into", str(tmp_path)]) == 0
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
    assert main(["new-follower", "mine", "--into", str(tmp_path)]) == 2
    assert "is there already" in capsys.readouterr().err


def test_a_name_that_is_no_package_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["new-vehicle", "My-Vehicle"]) == 2
    assert "small letters" in capsys.readouterr().err


def test_a_kits_vehicle_keeps_its_contract(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    write_kit("vehicle", "driven", tmp_path)
    monkeypatch.setattr(sys, "path", [str(tmp_path / "driven"), *sys.path])
    code = check_vehicle.main(["driven.vehicle:Driven", "--peer", "address", "--json"])
    found = {j["about"]: j for j in json.loads(capsys.readouterr().out)}
    assert [j for j in found.values() if j["passed"] is False] == []
    assert code == 0
    assert found["take_off"]["passed"]
    assert found["guarded"]["passed"]


def test_a_vehicle_that_moves_by_itself_fails(capsys: pytest.CaptureFixture[str]) -> None:
    assert check_vehicle.main([f"{__name__}:Eager", "--json"]) == 1
    found = {j["about"]: j for j in json.loads(capsys.readouterr().out)}
    assert not found["never raises"]["passed"]
    assert "unplugged" in found["never raises"]["text"]


class Eager(LogVehicle):
    """A vehicle whose driver lets an error of its link through."""

    def land(self) -> None:
        raise OSError("unplugged")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["absent_module:Nobody"], "absent_module"),
        (["log", "--set", "kind=submarine"], "options.kind"),
        (["log", "--peer", "address"], "options.address"),
        (["log", "--set", "kind"], "OPTION=VALUE"),
    ],
)
def test_a_vehicle_that_cannot_be_checked_is_named(
    words: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert check_vehicle.main(words) == 2
    assert said in capsys.readouterr().err


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
