"""`juncnet dashboard` and `juncnet up --with dashboard`: what is shown, with which options."""

from pathlib import Path

import pytest

from juncnet.assets import asset
from juncnet.flight import Flight
from juncnet.layout import SAVED, LayoutError, load_layout
from juncnet_services.cli import dashboard
from juncnet_services.cli.up import success_text
from juncnet_services.dashboard.access import Right, address_in
from juncnet_services.dashboard.service import Config


def config(directory: Path, *words: str) -> Config:
    return dashboard.configuration(dashboard.arguments(list(words)), str(directory))


def test_options_come_from_the_layout_that_the_flight_runs(tmp_path: Path) -> None:
    settings = ["dashboard.picture_rate_hz=5", "shared.camera.height_m=1.25"]
    layout = load_layout(asset("layouts/local.toml"), settings)
    layout.beside("dashboard").save(tmp_path / SAVED)
    shown = config(tmp_path, "--set", "dashboard.port=8099")
    assert (shown.picture_rate_hz, shown.camera.height_m, shown.port) == (5, 1.25, 8099)
    assert not shown.view_only
    other = config(tmp_path, "--layout", "rover", "--port", "8100", "--view-only")
    assert (other.port, other.view_only, other.camera.height_m) == (8100, True, 2.2)
    with pytest.raises(LayoutError, match="picture_rate"):
        config(tmp_path, "--set", "dashboard.picture_rates_hz=5")


def test_what_is_named_is_shown_and_without_a_flight_the_remedy_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert dashboard.targets(["a", "b:7447"], []) == ["a", "b:7447"]
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    assert dashboard.main(["--robot", "anna"]) == 1
    assert "no flight of robot anna runs here: start one" in capsys.readouterr().err
    assert dashboard.main(["--connect", str(tmp_path), "--layout", "nowhere"]) == 1
    assert "nowhere" in capsys.readouterr().err


def test_up_prints_the_address_of_a_dashboard_beside(tmp_path: Path) -> None:
    layout = load_layout(asset("layouts/local.toml")).beside("dashboard", "dashboard")
    assert layout.processes.count("dashboard") == 1
    layout.validate_all()
    flight = Flight("one", tmp_path, "robot", layout.processes)
    layout.save(tmp_path / SAVED)
    assert f"dashboard {address_in(tmp_path).url(Right.COMMAND)}" in success_text(flight)
    plain = Flight("two", tmp_path, "robot", ("router",))
    assert "dashboard" not in success_text(plain)
