"""systemd units: whole, in order, sound to systemd itself, removed without a trace."""

import configparser
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import pytest

import vehicle_side as side
from juncnet.access import Role
from juncnet.assets import asset, asset_path
from juncnet.identity import read_identity
from juncnet.layout import SAVED, load_layout
from juncnet.topics import SERVICES
from juncnet_services.cli.begin import main as begin
from juncnet_services.cli.systemd import UNITS, main, out_of_reach

FOLDER = asset("systemd/juncnet.target").parent
LAYOUTS = ("drone", "laptop")


def files(root: Path) -> list[str]:
    return sorted(str(p.relative_to(root)) for p in root.rglob("*") if p.is_file())


def installed(root: Path, layout: str, *more: str) -> Path:
    assert main(["install", layout, "--root", str(root), *more]) == 0
    return root / UNITS


def unit(path: Path) -> configparser.ConfigParser:
    """Return a unit as sections; of an option that is there twice, the last."""
    parser = configparser.ConfigParser(strict=False, interpolation=None, delimiters=("=",))
    parser.optionxform = str  # type: ignore[assignment,method-assign]
    parser.read(path)
    return parser


@pytest.mark.parametrize("layout", LAYOUTS)
def test_each_process_of_the_layout_is_wanted(tmp_path: Path, layout: str) -> None:
    units = installed(tmp_path, layout)
    text = (units / "juncnet.target.d/processes.conf").read_text()
    wanted = re.findall(r"^Wants=juncnet@(\w+)\.service$", text, re.MULTILINE)
    assert tuple(wanted) == load_layout(asset_path(layout, "layouts", ".toml")).processes
    start = unit(units / "juncnet@.service")["Service"]["ExecStart"]
    assert start.startswith(f"{sys.executable} -m juncnet_services.%i --layout /etc/juncnet/")
    assert "@PYTHON@" not in "".join(p.read_text() for p in units.rglob("*.*") if p.is_file())


def test_the_vehicles_process_starts_first_then_the_router() -> None:
    vehicle = (FOLDER / "juncnet@command_output.service.d/vehicle.conf").read_text()
    router = (FOLDER / "juncnet@router.service.d/order.conf").read_text()
    others = {*SERVICES, "simulator", "recorder", "dashboard"} - {"command_output"}
    assert set(re.findall(r"juncnet@(\w+)\.service", vehicle)) == others | {"router"}
    assert set(re.findall(r"juncnet@(\w+)\.service", router)) == others


def test_the_guard_outlives_its_process() -> None:
    service = unit(FOLDER / "juncnet@command_output.service.d/vehicle.conf")["Service"]
    assert service["KillMode"] == "process"
    assert service["OOMPolicy"] == "continue"
    assert service["RestrictRealtime"] == "no"
    assert service["LimitRTPRIO"] == "1"


def test_a_process_is_started_anew_unless_it_is_misconfigured() -> None:
    parser = unit(FOLDER / "juncnet@.service")
    assert parser["Service"]["Restart"] == "on-failure"
    assert parser["Service"]["RestartPreventExitStatus"] == "2"
    assert parser["Unit"]["StartLimitIntervalSec"] == "0"


def analyze(units: Path, *words: str) -> "subprocess.CompletedProcess[str]":
    if shutil.which("systemd-analyze") is None:
        pytest.skip("systemd-analyze is not installed")
    return subprocess.run(
        ["systemd-analyze", *words],
        env={**os.environ, "SYSTEMD_UNIT_PATH": f"{units}:"},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )


def instances(layout: str) -> Sequence[str]:
    processes = load_layout(asset_path(layout, "layouts", ".toml")).processes
    return [f"juncnet@{name}.service" for name in processes]


@pytest.mark.parametrize("layout", LAYOUTS)
def test_systemd_finds_nothing_wrong(tmp_path: Path, layout: str) -> None:
    units = installed(tmp_path, layout)
    names = ["juncnet.target", "juncnet-flight.service", *instances(layout)]
    checked = analyze(units, "verify", "--man=no", *names)
    ours = [line for line in checked.stderr.splitlines() if "juncnet" in line]
    assert ours == []
    assert checked.returncode == 0


def test_the_services_are_hardened(tmp_path: Path) -> None:
    units = installed(tmp_path, "drone")
    paths = [str(units / "juncnet@.service")]
    checked = analyze(units, "security", "--offline=yes", "--threshold=30", "--no-pager", *paths)
    if "unrecognized option" in checked.stderr:
        pytest.skip("this systemd-analyze cannot judge units offline")
    assert checked.returncode == 0, checked.stdout[-2000:] + checked.stderr


def test_what_is_installed_is_removed_but_the_robots_own(tmp_path: Path) -> None:
    certificates = side.certificates(tmp_path / "certificates") / Role.DRONE
    root = tmp_path / "root"
    installed(root, "drone", "--certificates", str(certificates))
    own = root / "etc/juncnet/layout.toml"
    assert read_identity(root / "etc/juncnet/certificates").role is Role.DRONE
    assert load_layout(own).links.certificates == Path("/etc/juncnet/certificates")
    own.write_text(own.read_text() + '\n[launch]\nrobot = "scout"\n')
    installed(root, "drone", "--certificates", str(certificates))
    assert load_layout(own).launch.robot == "scout"
    assert main(["remove", "--root", str(root)]) == 0
    assert files(root) == [
        "etc/juncnet/certificates/ca.pem",
        "etc/juncnet/certificates/certificate.pem",
        "etc/juncnet/certificates/key.pem",
        "etc/juncnet/layout.toml",
    ]
    assert main(["remove", "--root", str(root), "--purge"]) == 0
    assert files(root) == []


def test_what_cannot_be_installed_is_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["install", "nowhere", "--root", str(tmp_path)]) == 2
    assert "nowhere" in capsys.readouterr().err
    missing = ["--certificates", str(tmp_path / "none")]
    assert main(["install", "drone", "--root", str(tmp_path), *missing]) == 2
    assert "deploy/certificates" in capsys.readouterr().err


def test_another_layout_is_not_installed_over_the_robots_own(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    installed(tmp_path, "drone")
    before = files(tmp_path)
    assert main(["install", "px4_copter", "--root", str(tmp_path)]) == 2
    assert "correct its `extends`" in capsys.readouterr().err
    assert files(tmp_path) == before
    installed(tmp_path, "drone")


def test_a_checkout_in_a_private_home_is_out_of_reach(tmp_path: Path) -> None:
    home = tmp_path / "home"
    (home / "juncnet").mkdir(parents=True)
    home.chmod(0o700)
    assert out_of_reach(home / "juncnet" / "python") == home
    assert out_of_reach(Path("/usr/bin/env")) is None


def test_each_start_is_a_flight_of_its_own() -> None:
    with tempfile.TemporaryDirectory(prefix="jn-") as folder:
        _two_starts(Path(folder))


def _two_starts(root: Path) -> None:
    seen: list[Path] = []
    for _ in range(2):
        assert begin(["drone", "--root", str(root)]) == 0
        seen.append((root / "flight").resolve())
        assert (root / "flight" / "flight.json").exists()
        assert (root / "flight" / SAVED).exists()
        assert seen[-1].stat().st_mode & 0o777 == 0o700
    assert seen[0] != seen[1]
    assert not seen[0].exists()
    assert begin(["nowhere", "--root", str(root)]) == 2
