"""`juncnet doctor --vehicle` against vehicles that answer as a Bebop and an autopilot do."""

from collections.abc import Sequence
from pathlib import Path

import pytest

from bebop_drone import Drone, flying_drone
from juncnet.assets import asset_path
from juncnet.layout import load_layout
from juncnet_services.cli.doctor import parts
from juncnet_services.cli.doctor.findings import Finding, Level
from videos import free_port


def asked(name: str, settings: Sequence[str], folder: Path) -> dict[str, Finding]:
    """Return what doctor finds of the vehicle of a shipped layout, by what it is about."""
    layout = load_layout(asset_path(name, "layouts", ".toml"), settings)
    return {finding.about: finding for finding in parts.vehicle(layout, True, folder)}


def bebop(drone: Drone) -> list[str]:
    return [
        "command_output.options.address=127.0.0.1",
        "command_output.options.events_port=0",
        f"command_output.options.discovery_port={drone.port}",
    ]


def test_a_bebop_that_answers(tmp_path: Path) -> None:
    with flying_drone() as drone:
        found = asked("bebop", bebop(drone), tmp_path)
    assert found["vehicle"].level is Level.OK
    assert found["battery"].text == "87 %"


def test_a_bebop_that_another_controller_has(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(parts, "ANSWER_S", 2.0)
    with flying_drone(Drone(status=-3000)) as drone:
        found = asked("bebop", bebop(drone), tmp_path)["vehicle"]
    assert found.level is Level.FAILURE
    assert "status -3000" in found.text
    assert "close the phone's app" in found.remedy


@pytest.mark.parametrize(
    ("name", "kind", "px4", "changed", "remedy"),
    [
        ("px4_copter", "copter", True, {}, ""),
        ("px4_copter", "copter", True, {"COM_OBL_RC_ACT": 0}, "set COM_OBL_RC_ACT to 5 (Hold)"),
        ("px4_copter", "copter", True, {"COM_OF_LOSS_T": 60}, "set COM_OF_LOSS_T to 1.5"),
        ("ardupilot_rover", "rover", False, {}, ""),
        ("ardupilot_rover", "rover", False, {"FS_GCS_ENABLE": 0}, "set FS_GCS_ENABLE to 1"),
        ("px4_copter", "rover", True, {}, "set options.kind"),
    ],
)
def test_an_autopilots_parameters(
    name: str, kind: str, px4: bool, changed: dict[str, float], remedy: str, tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    pytest.importorskip("pymavlink", reason="extra [mavlink] is not installed")
    from autopilot import ROVER, STRICT, Autopilot, flying

    monkeypatch.setattr(parts, "ANSWER_S", 8.0 if not remedy else 4.0)
    port = free_port()
    pilot = Autopilot(kind, (STRICT if px4 else ROVER) | changed, px4=px4)
    with flying(pilot, port):
        url = f"command_output.options.url=udpin:127.0.0.1:{port}"
        found = asked(name, [url], tmp_path)
    assert not pilot.armed
    if not remedy:
        assert found["vehicle"].level is Level.OK
        assert found["battery"].text == "77 %"
        return
    assert found["vehicle"].level is Level.FAILURE
    assert remedy in found["vehicle"].remedy
