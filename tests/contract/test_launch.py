"""Layouts and `launch`: refusals name what is wrong, processes end as they should."""

import signal
import subprocess
import sys
from pathlib import Path

import pytest
from pydantic import BaseModel, ConfigDict

import peers
from juncnet.assets import asset, asset_path
from juncnet.layout import LayoutError, load_layout

LAYOUT = """processes = ["router"]
[launch]
robot = "rover-1"
[router]
port = 0
"""


class Config(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")
    port: int = 1
    host: str = "localhost"


@pytest.fixture(name="path")
def _path(tmp_path: Path) -> Path:
    path = tmp_path / "layout.toml"
    path.write_text(LAYOUT)
    return path


def test_settings_override_the_file(path: Path) -> None:
    layout = load_layout(path, ["router.port=7", "router.host=here", "launch.robot='r2'"])
    assert layout.section("router", Config) == Config(port=7, host="here")
    assert layout.launch.robot == "r2"
    assert layout.state_dir == Path.home() / ".local/state/juncnet/r2"


@pytest.mark.parametrize(
    ("setting", "text"),
    [
        ("launch.robt='x'", r"\[launch\] robt: no such option: did you mean 'robot'"),
        ("launch.robot='a b'", r"\[launch\] robot: "),
        ("ruter.port=1", r"\[ruter\] is no process of this layout: did you mean 'router'"),
        ("bus.frames='shm'", r"\[bus\] frames: .*'iceoryx2'"),
        ("nonsense", r"write section\.option=value"),
    ],
)
def test_what_is_wrong_is_named(path: Path, setting: str, text: str) -> None:
    with pytest.raises(LayoutError, match=text):
        load_layout(path, [setting])


def test_links_are_options_of_the_router_and_of_no_other_process() -> None:
    settings = ["links.vehicle=127.0.0.1:7447", "links.video=127.0.0.1:7448"]
    layout = load_layout(asset("layouts/laptop.toml"), settings)
    layout.beside("recorder").validate_all()


def test_a_section_is_validated_by_its_service(path: Path) -> None:
    layout = load_layout(path, ["router.prot=1", "router.port='x'"])
    with pytest.raises(LayoutError) as raised:
        layout.validate_all()
    lines = str(raised.value).splitlines()
    assert any("[router] prot: no such option: did you mean 'port'?" in line for line in lines)
    assert any("[router] port: " in line for line in lines)
    assert all(line.startswith(str(path)) for line in lines)


def test_assets_are_found_by_name() -> None:
    assert asset("layouts/local.toml") == asset_path("local", "layouts", ".toml")
    with pytest.raises(FileNotFoundError, match=r"local\.toml"):
        asset("layouts/nowhere.toml")


def _router(path: Path, *arguments: str) -> "subprocess.Popen[str]":
    command = [sys.executable, "-m", "juncnet_services.router", "--layout", str(path)]
    return subprocess.Popen([*command, *arguments], stderr=subprocess.PIPE, text=True)


def test_a_process_ends_cleanly_on_sigterm(path: Path) -> None:
    with peers.a_flight("rover-1") as flight:
        process = _router(path, "--flight-dir", str(flight.directory))
        assert peers.eventually((flight.directory / "router.endpoint").exists)
        process.send_signal(signal.SIGTERM)
        _, log = process.communicate(timeout=5)
        assert process.returncode == 0
        assert "router: ended" in log
        assert f"flight {flight.id}" in log


def test_a_failed_process_ends_with_1_and_a_misconfigured_one_with_2(path: Path) -> None:
    with peers.a_flight("rover-1") as flight:
        directory = ("--flight-dir", str(flight.directory))
        open_door = "links.allow_anyone_on_the_network_to_fly_this_robot=true"
        elsewhere = ("--set", "router.host=256.0.0.1", "--set", open_door)
        process = _router(path, *directory, *elsewhere)
        _, log = process.communicate(timeout=10)
        assert process.returncode == 1
        assert "ERROR   router: failed" in log
        process = _router(path, *directory, "--set", "router.prt=1")
        _, log = process.communicate(timeout=10)
        assert process.returncode == 2
        assert log.strip().endswith("[router] prt: no such option: did you mean 'port'?")
