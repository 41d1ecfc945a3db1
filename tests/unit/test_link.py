"""The vehicle link: round trips, refusals, sockets, and no imports beyond the standard library."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from juncnet.simulation import link

TELEMETRY = link.Telemetry(123, 1.0, 2.0, 3.0, 0.5, 2.0, 0.0, 0.1, True, 0.9)


def test_round_trips() -> None:
    setpoint = link.Setpoint(3.0, 0.1, -0.2, 0.5, True)
    assert link.decode_command(link.encode(setpoint)) == setpoint
    assert link.decode_command(link.encode(link.Hello())) == link.Hello()
    assert link.decode_telemetry(link.encode(TELEMETRY)) == TELEMETRY
    assert link.HOLD.brake


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"forward_mps": "fast"}, "forward_mps"),
        ({"forward_mps": float("nan")}, "forward_mps"),
        ({"yaw_rate_radps": 1e300}, "yaw_rate_radps"),
        ({"yaw_rate_radps": 10**400}, "yaw_rate_radps"),
        ({"brake": 1}, "brake"),
        ({"lateral_mps": True}, "lateral_mps"),
        ({"speed": 1.0}, "speed"),
        ({"type": "take_off"}, "type"),
        ({"type": ["setpoint"]}, "type"),
    ],
)
def test_malformed_fields_are_named(change: dict[str, object], field: str) -> None:
    values = {**json.loads(link.encode(link.Setpoint())), **change}
    with pytest.raises(link.LinkError, match=field):
        link.decode_command(json.dumps(values).encode())


@pytest.mark.parametrize("datagram", [b"", b"\xff\xfe", b"[1]", b"{", b'{"type":"setpoint"}'])
def test_malformed_datagrams(datagram: bytes) -> None:
    with pytest.raises(link.LinkError):
        link.decode_command(datagram)
    with pytest.raises(link.LinkError):
        link.decode_telemetry(datagram)


def test_sockets_reach_each_other(tmp_path: Path) -> None:
    link.server_address(tmp_path).touch()  # what a dead simulator left
    server, client = link.open_server(tmp_path), link.open_client(tmp_path)
    with server, client:
        client.sendto(link.encode(link.Hello()), str(link.server_address(tmp_path)))
        datagram, sender = server.recvfrom(link.MAX_DATAGRAM)
        assert link.decode_command(datagram) == link.Hello()
        server.sendto(link.encode(TELEMETRY), sender)
        assert link.decode_telemetry(client.recv(link.MAX_DATAGRAM)) == TELEMETRY


def test_long_paths_are_refused(tmp_path: Path) -> None:
    with pytest.raises(link.LinkError, match="too long"):
        link.open_client(tmp_path / ("x" * 120))


def test_needs_only_the_standard_library() -> None:
    names = "'numpy' in sys.modules, 'pydantic' in sys.modules"
    code = f"import sys, juncnet.simulation.link; print({names})"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert out.stdout.split() == ["False", "False"]
