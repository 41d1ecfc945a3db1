"""up, status and down with real processes."""

import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Generator
from pathlib import Path

import psutil
import pytest

from juncnet_services.cli import down, events, status, supervise, up
from juncnet_services.cli.local_flights import all_flights, pids_of, running_flights, started_by_up
from juncnet_services.cli.supervise import Supervisor

LAYOUT = """
processes = ["frame_capture", "command_output", "router"]
[launch]
robot = "cli-test"
state_dir = "{folder}/state"
[command_output]
vehicle = "log"
"""


@pytest.fixture
def layout(monkeypatch: pytest.MonkeyPatch) -> Generator[Path]:
    """Return a layout, with a short folder of its own for flights; ends what a test leaves."""
    with tempfile.TemporaryDirectory(prefix="jn-") as folder:
        monkeypatch.setenv("XDG_RUNTIME_DIR", folder)
        path = Path(folder) / "small.toml"
        path.write_text(LAYOUT.format(folder=folder))
        yield path
        down.main(["--all"])


def test_up_status_down(layout: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert up.main([str(layout)]) == 0
    (flight,) = running_flights("cli-test")
    assert str(flight.directory) in capsys.readouterr().out
    assert len(pids_of(flight)) == 3

    assert up.main([str(layout)]) == 2
    assert "is up already" in capsys.readouterr().err

    assert status.main(["--json"]) == 0
    (found,) = json.loads(capsys.readouterr().out)
    assert found["robot"] == "cli-test"
    assert {row["state"] for row in found["processes"]} == {"running"}
    assert {row["process"]: row["pid"] for row in found["processes"]}.keys() == set(
        flight.processes
    )
    assert status.main([]) == 0
    assert "command_output" in capsys.readouterr().out
    assert events.main(["--for", "0.2"]) == 0

    pids = pids_of(flight)
    assert down.main(["--robot", "cli-test"]) == 0
    assert not any(Path("/proc", str(pid)).exists() for pid in pids)
    assert all_flights() == []
    assert down.main(["--robot", "cli-test"]) == 0
    assert "nothing is up" in capsys.readouterr().out
    assert status.main([]) == 1


def test_up_says_which_process_does_not_work_and_why(
    layout: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    setting = 'frame_capture.source={kind="file", path="missing.mp4"}'
    assert up.main([str(layout), "--set", setting]) == 1
    text = capsys.readouterr().err
    assert "1 of 3 processes will not work" in text
    assert "frame_capture (exited)" in text
    assert "missing.mp4" in text
    assert status.main([]) == 1


@pytest.mark.parametrize("odd", ["a #b", "a ;b", "100 %(here)s 'x'\n#c"])
def test_any_character_may_stand_in_folders_and_options(
    layout: Path, odd: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = layout.parent / odd
    folder.mkdir()
    monkeypatch.chdir(folder)
    path = layout.rename(folder / f"{odd}.toml")
    state = f"launch.state_dir={json.dumps(odd)}"
    assert up.main([str(path), "--set", state, "--timeout", "20"]) == 0
    (flight,) = running_flights()
    assert len(pids_of(flight)) == 3
    assert (folder / odd).is_dir()


def test_up_leaves_nothing_behind_where_no_process_starts(
    layout: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    setting = "launch.state_dir=/dev/null/state"
    assert up.main([str(layout), "--set", setting]) == 1
    told = capsys.readouterr().err
    assert "no process of this flight is running" in told
    assert "3 of 3 processes will not work" in told
    assert "NotADirectoryError" in told
    assert "INFO spawned: 'router'" in told
    (flight,) = all_flights()
    assert f"their logs are in {flight.directory}" in told
    assert pids_of(flight) == []
    assert not Supervisor(flight.directory).running
    assert not started_by_up(flight)


def test_up_leaves_no_supervisor_behind_that_does_not_answer(
    layout: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(supervise, "START_TIMEOUT_S", 0.0)
    assert up.main([str(layout)]) == 1
    assert "supervisord did not start" in capsys.readouterr().err
    (flight,) = all_flights()
    conf = str(flight.directory / supervise.CONF)
    assert not [p for p in psutil.process_iter() if conf in cmdline(p)]


def test_up_tells_what_the_supervisor_said_before_it_had_a_log(
    layout: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    head = supervise._HEAD.replace("[unix_http_server]", "[nonsense")  # pyright: ignore[reportPrivateUsage]
    monkeypatch.setattr(supervise, "_HEAD", head)
    began = time.monotonic()
    assert up.main([str(layout)]) == 1
    assert "nonsense" in capsys.readouterr().err
    assert time.monotonic() - began < supervise.START_TIMEOUT_S / 2


def test_a_module_of_the_working_directory_does_not_stand_in_for_pythons(
    layout: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "grp.py").write_text("raise ImportError('not this one')")
    monkeypatch.chdir(tmp_path)
    assert up.main([str(layout.resolve())]) == 0
    assert down.main([]) == 0


def cmdline(process: psutil.Process) -> list[str]:
    try:
        return process.cmdline()
    except psutil.Error:  # it has ended
        return []


def test_a_wrong_layout_starts_nothing(layout: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert up.main([str(layout), "--set", "frame_capture.frozen_limt=3"]) == 2
    assert "frozen_limit" in capsys.readouterr().err
    assert up.main(["no-such-layout"]) == 2
    assert all_flights() == []


def test_down_ends_processes_whose_supervisor_was_killed(layout: Path) -> None:
    assert up.main([str(layout)]) == 0
    (flight,) = running_flights()
    supervisor = int((flight.directory / "supervisord.pid").read_text())
    os.kill(supervisor, signal.SIGKILL)
    assert pids_of(flight)
    assert down.main(["--keep"]) == 0
    assert not Supervisor(flight.directory).running
    assert pids_of(flight) == []
    assert (flight.directory / "command_output.log").exists()


@pytest.mark.parametrize("processes", [0, 8], ids=["starting", "started"])
@pytest.mark.parametrize("later_s", [0.0, 0.3, 2.0])
def test_a_terminated_demo_leaves_nothing(layout: Path, processes: int, later_s: float) -> None:
    small = ["--set", "simulator.width=320", "--set", "simulator.height=180"]
    command = [sys.executable, "-m", "juncnet_services.cli", "demo", "--headless", "--no-dashboard"]
    demo = subprocess.Popen([*command, *small], stderr=subprocess.DEVNULL)
    try:
        deadline = time.monotonic() + 60
        while not (flights := all_flights()) or len(pids_of(flights[0])) < processes:
            assert time.monotonic() < deadline
            assert demo.poll() is None
            time.sleep(0.02)
        time.sleep(later_s)
        demo.terminate()
        assert demo.wait(30) == 128 + signal.SIGTERM
    finally:
        demo.kill()
        demo.wait()
    assert pids_of(flights[0]) == []
    assert all_flights() == []
