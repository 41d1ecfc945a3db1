"""`juncnet doctor`: each thing that may be wrong before a flight is found, with its remedy."""

import json
import re
import shutil
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

import peers
import vehicle_side as side
from fakes import FakeBus
from juncnet.access import Role
from juncnet.assets import asset_path
from juncnet.flight import Flight
from juncnet.identity import CA, CERTIFICATE, KEY, read_identity
from juncnet.launch import open_gateway
from juncnet.layout import Layout, load_layout
from juncnet.messages import Capabilities, Health, Output, RemoteClock, VehicleState
from juncnet.topics import VEHICLE_STATE, health_topic
from juncnet_services.cli.doctor import links, parts, running
from juncnet_services.cli.doctor.examine import main
from juncnet_services.cli.doctor.findings import Finding, Level, lines, worst
from keeping_vehicle import KeepingVehicle

NOW = datetime.now(UTC)
FLIGHT = Flight("f", Path("/nowhere"), "robot", ("frame_capture", "command_output"))


@pytest.fixture(name="folder", scope="module")
def _folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return side.certificates(tmp_path_factory.mktemp("ours") / "certificates")


def layout(name: str, *settings: str) -> Layout:
    return load_layout(asset_path(name, "layouts", ".toml"), settings)


def drone(folder: Path, *settings: str) -> Layout:
    return layout("drone", f"links.certificates={folder / Role.DRONE}", *settings)


def only(findings: Iterator[Finding]) -> Finding:
    found = list(findings)
    assert len(found) == 1
    assert bool(found[0].remedy) is (found[0].level is not Level.OK)
    return found[0]


def test_certificates_in_order(folder: Path) -> None:
    found = only(links.certificates(drone(folder), NOW))
    assert found.level is Level.OK
    assert re.search(r"36[45] days", found.text)
    assert "localhost" in found.text


def test_certificates_that_end_soon_are_to_be_renewed(folder: Path) -> None:
    found = only(links.certificates(drone(folder), NOW + timedelta(days=340)))
    assert found.level is Level.WARNING
    assert "--renew drone" in found.remedy


def test_certificates_of_another_role_and_none_at_all(folder: Path) -> None:
    wrong = layout("laptop", f"links.certificates={folder / Role.VIEWER}")
    assert "needs navigation" in only(links.certificates(wrong, NOW)).text
    missing = layout("laptop", "links.certificates=/nowhere")
    found = only(links.certificates(missing, NOW))
    assert found.level is Level.FAILURE
    assert "deploy/certificates" in found.remedy
    assert "deploy/certificates" not in found.text
    assert "any local user" in only(links.certificates(layout("local"), NOW)).text
    free = "links.allow_anyone_on_the_network_to_fly_this_robot=true"
    found = only(links.certificates(layout("local", free), NOW))
    assert found.level is Level.WARNING
    assert "ANYONE ON THE NETWORK" in found.text


def test_a_clock_that_forgot_the_date() -> None:
    assert links.wall_clock(datetime(1970, 1, 1, tzinfo=UTC)).level is Level.FAILURE
    assert links.wall_clock(NOW).level is Level.OK


def test_a_directory_that_others_can_enter(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    assert links.sockets().level is Level.OK
    (tmp_path / "juncnet").chmod(0o755)
    assert "chmod 700" in links.sockets().remedy


def test_a_port_that_is_taken(folder: Path) -> None:
    address = side.free_address()
    host, _, port = address.partition(":")
    at = (f"router.host={host}", f"router.port={port}", f"router.video_port={port}")
    assert only(links.router(drone(folder, *at), False)).level is Level.OK
    with peers.a_flight() as flight, open_gateway(flight, f"tcp/{address}"):
        assert "taken" in only(links.router(drone(folder, *at), False)).text
        assert only(links.router(drone(folder, *at), True)).level is Level.OK
    assert list(links.router(layout("laptop"), False)) == []


def test_a_vehicle_that_answers_and_ones_that_do_not(folder: Path, tmp_path: Path) -> None:
    address = side.free_address()
    viewer = read_identity(folder / Role.VIEWER)
    found = links.dial(address, viewer)
    assert found.level is Level.FAILURE
    assert "WiFi" in found.remedy
    with (
        peers.a_flight() as flight,
        open_gateway(flight, f"tls/{address}", read_identity(folder / Role.DRONE)),
    ):
        assert links.dial(address, viewer).level is Level.OK
        other_name = address.replace("127.0.0.1", "127.0.0.2")
        refused = links.dial(other_name, viewer)
        assert refused.level is Level.FAILURE
        theirs = side.certificates(tmp_path / "theirs")
        foreign = links.dial(address, read_identity(theirs / Role.VIEWER))
        assert "deploy/certificates" in foreign.remedy
        stranger = side.foreign_identity(folder, theirs, tmp_path / "stranger")
        assert links.dial(address, stranger).level is Level.FAILURE
    with peers.a_flight() as flight, open_gateway(flight, f"tcp/{address}"):
        assert links.dial(address, None).level is Level.OK
        assert links.dial(address, viewer).level is Level.FAILURE


def test_a_vehicle_under_a_name_that_its_certificate_lacks(folder: Path) -> None:
    address = side.free_address().replace("127.0.0.1", "127.0.0.2")
    with (
        peers.a_flight() as flight,
        open_gateway(flight, f"tls/{address}", read_identity(folder / Role.DRONE)),
    ):
        found = links.dial(address, read_identity(folder / Role.VIEWER))
    assert found.level is Level.FAILURE
    assert "--host 127.0.0.2" in found.remedy


def test_models(tmp_path: Path) -> None:
    assert only(parts.model(layout("local"))).level is Level.OK
    (tmp_path / "bad.onnx").write_bytes(b"not a model")
    for name in ("nothing", str(tmp_path / "bad.onnx")):
        found = only(parts.model(layout("local", f"junction_inference.model={name}")))
        assert found.level is Level.FAILURE
        assert ".onnx" in found.remedy
    assert list(parts.model(layout("drone"))) == []


def test_cameras(tmp_path: Path) -> None:
    path = tmp_path / "drive.mp4"
    named = layout("video", f"frame_capture.source.path={path}")
    assert only(parts.camera(named)).level is Level.FAILURE
    path.touch()
    assert only(parts.camera(named)).level is Level.OK
    assert "rtp 5600" in only(parts.camera(layout("drone"))).text


def test_vehicles(tmp_path: Path) -> None:
    def look(*settings: str, ask: bool = False) -> Finding:
        return only(parts.vehicle(layout("video", *settings), ask, tmp_path))

    assert look().level is Level.OK
    assert look(ask=True).level is Level.OK
    assert list(parts.vehicle(layout("laptop"), True, tmp_path)) == []


def test_a_vehicle_in_trouble(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(parts, "ANSWER_S", 0.2)
    settings = KeepingVehicle.Options.model_validate({})
    vehicle = KeepingVehicle(settings, Path())  # pyright: ignore[reportArgumentType]
    vehicle.trouble = "COM_OF_LOSS_T is 60: set it to 0.5"
    found = only(parts.answers("px4", vehicle))
    assert found.level is Level.FAILURE
    assert "COM_OF_LOSS_T" in found.text
    assert parts.battery(0.2).level is Level.WARNING


def test_disks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    here = layout("local", f"launch.state_dir={tmp_path / 'not' / 'yet'}")
    monkeypatch.setattr(parts, "LITTLE_BYTES", 1)
    monkeypatch.setattr(parts, "ENOUGH_BYTES", 2)
    assert worst(parts.disk(here)) is Level.OK
    monkeypatch.setattr(parts, "ENOUGH_BYTES", 1 << 70)
    assert worst(parts.disk(here)) is Level.WARNING
    monkeypatch.setattr(parts, "LITTLE_BYTES", 1 << 70)
    assert worst(parts.disk(here)) is Level.FAILURE


def health(bus: FakeBus, service: str, **fields: object) -> Health:
    known = {"service": service, "at": bus.stamp(), "flight": "f", "pid": 1, "rate_hz": 25.0}
    return Health.model_validate(known | fields)


def test_a_flight_is_heard() -> None:
    stamps = FakeBus()
    clocks = {"boot-2": RemoteClock(offset_ns=5_000_000, uncertainty_ns=1_000_000)}
    report = health(stamps, "frame_capture", clocks=clocks, linked=True)
    state = VehicleState(at=stamps.stamp(), capabilities=Capabilities(), output=Output.HOLD)
    script = [(health_topic("frame_capture"), report), 0.5, (VEHICLE_STATE, state), 3.0]
    healths, heard = running.listen(FakeBus(script), FLIGHT)
    assert healths == {"frame_capture": report}
    assert heard == state
    silent = only(running.processes(FLIGHT, healths))
    assert "command_output did not report" in silent.text
    clock = only(running.clocks(healths))
    assert clock.level is Level.OK
    assert "+5.0 ms ahead, +- 1.0 ms" in clock.text


def test_what_a_flight_complains_of() -> None:
    bus = FakeBus()
    unknown, vague = RemoteClock(), RemoteClock(offset_ns=0, uncertainty_ns=90_000_000)
    healths = {
        "frame_capture": health(bus, "frame_capture", rate_hz=0.0, last_error="no device"),
        "junction_navigation": health(
            bus, "junction_navigation", linked=False, clocks={"a": vague}
        ),
        "command_output": health(bus, "command_output", clocks={"b": unknown}),
    }
    assert worst(running.processes(FLIGHT, healths)) is Level.FAILURE
    levels = [finding.level for finding in running.clocks(healths)]
    assert levels == [Level.WARNING, Level.FAILURE]
    assert "no device" in only(running.camera(healths)).text
    assert only(running.vehicle(None)).level is Level.FAILURE
    stopped = VehicleState(
        at=bus.stamp(), capabilities=Capabilities(), output=Output.STOPPED, battery=0.9
    )
    found = list(running.vehicle(stopped))
    assert [finding.level for finding in found] == [Level.WARNING, Level.OK]
    assert "juncnet resume" in found[0].remedy


def test_the_command_says_all_and_its_code_says_whether_to_fly(
    folder: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    assert main(["video", "--set", "frame_capture.source.path=/nowhere.mp4"]) == 1
    text = capsys.readouterr().out
    assert "FAIL  camera" in text
    assert "-> " in text
    video = tmp_path / "drive.mp4"
    video.touch()
    assert main(["video", "--set", f"frame_capture.source.path={video}", "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert {"certificates", "clock", "model", "camera", "vehicle", "disk"} <= {
        finding["about"] for finding in answer["findings"]
    }
    assert main(["video", "--set", "command_output.vehicle=helicopter"]) == 1
    assert "FAIL  layout" in capsys.readouterr().out
    assert main(["nowhere"]) == 2
    lost = tmp_path / "lost"
    shutil.copytree(folder / Role.NAVIGATION, lost)
    for name in (CA, CERTIFICATE, KEY):
        assert (lost / name).exists()
    (lost / KEY).chmod(0o644)
    assert main(["laptop", "--set", f"links.certificates={lost}"]) == 1
    assert "-> chmod 600" in capsys.readouterr().out
    assert main(["local", "--flight", str(lost)]) == 2
    assert "is no flight's directory" in capsys.readouterr().err


def test_findings_are_lines_for_people() -> None:
    bad = Finding(about="disk", level=Level.FAILURE, text="full", remedy="make room")
    assert list(lines([bad])) == ["FAIL  disk          full", f"{'':20}-> make room"]
    assert worst([]) is Level.OK
