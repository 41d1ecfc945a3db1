"""How the processes of a flight are linked: Zenoh settings, as plain data.

A full mesh of peers over Unix sockets in the flight's directory. Every process listens on a socket
of its own and dials all others, so a restarted one is heard as soon as it runs (measured: first
message 5-20 ms after its session opens, and 4 ms to open it) and the death of one cuts nobody
else's link. Both ends dial: that costs nothing (one link is kept, no message comes twice) and
saves waiting for a redial. A gateway, Zenoh in router mode, joins the mesh for outsiders on TCP.

With certificates the gateway speaks TLS only, knows who dials by certificate, and denies what that
role may not do. Rights are judged by the certificate of the link on which something comes in, so a
remote tool links to the vehicle's gateway itself, never through another one.

From another host a process dials the vehicle's router twice, for control and for video, so that a
picture never delays a command: with one TCP connection the kernel's buffer is the queue, whatever
the priorities. The video link's buffer is small as well, for what is in it is late. An outage is
ended by dialling anew, because TCP would wait longer and longer between its own attempts.

`scouting.delay` 0 matters: without it every start waits 0.5 s for scouting that is switched off.
"""

import ipaddress
from dataclasses import dataclass
from typing import Any

from juncnet.access import access_control
from juncnet.flight import Flight
from juncnet.identity import Identity

ROUTER = "router"
"""The process that opens a gateway, in layouts that have one."""
GATEWAY = "gateway"
REDIAL_MS = 100
LEASE_MS = 2000
"""A hung process counts as gone after this; a dead one at once."""
REMOTE_LEASE_MS = 1000
"""Of links between hosts: a silent one is given up and dialled anew after this."""
OPEN_TIMEOUT_MS = 2000
"""An attempt to dial another host is given up after this."""
VIDEO_BUFFER = 65536
"""Bytes of the kernel's send buffer of a video link, which Linux doubles."""


@dataclass(frozen=True)
class RemoteSettings:
    """Zenoh settings of the two sessions of a process with the vehicle's router."""

    control: dict[str, Any]
    """For all topics but bulk ones."""
    bulk: dict[str, Any]
    """For video and pictures."""


def _settings(mode: str, listen: list[str], dial: list[str]) -> dict[str, Any]:
    return {
        "mode": mode,
        "listen": {"endpoints": listen, "exit_on_failure": True},
        "connect": {
            "endpoints": dial,
            "timeout_ms": -1,
            "exit_on_failure": False,
            "retry": {
                "period_init_ms": REDIAL_MS,
                "period_max_ms": REDIAL_MS,
                "period_increase_factor": 1,
            },
        },
        "scouting": {
            "delay": 0,
            "multicast": {"enabled": False},
            "gossip": {"enabled": False},
        },
        "timestamping": {"enabled": True},
        "transport": {
            "shared_memory": {"enabled": False},
            "link": {"tx": {"lease": LEASE_MS}},
        },
        "routing": {"router": {"peers_failover_brokering": False}},
    }


def _others(flight: Flight, process: str) -> list[str]:
    names = [*flight.processes, *([GATEWAY] if ROUTER in flight.processes else [])]
    return [flight.socket(name) for name in names if name != process]


def member(flight: Flight, process: str) -> dict[str, Any]:
    """Return the settings of a process of the flight."""
    return _settings("peer", [flight.socket(process)], _others(flight, process))


def visitor(flight: Flight) -> dict[str, Any]:
    """Return the settings of a tool on this host that joins the mesh and listens nowhere."""
    return _settings("peer", [], _others(flight, ""))


def gateway(
    flight: Flight, endpoint: str, identity: Identity | None = None, video: str | None = None
) -> dict[str, Any]:
    """Return the settings of the router that lets outsiders in on `endpoint`, and on `video`.

    With an identity, by certificate and by the rights of their roles; without, whoever comes.

    Raises:
        ValueError: the identity is not a vehicle's.
    """
    listen = [flight.socket(GATEWAY), endpoint, *([] if video is None else [_small_buffer(video)])]
    settings = _settings("router", listen, _others(flight, GATEWAY))
    settings["transport"]["link"]["tx"]["lease"] = REMOTE_LEASE_MS
    if identity is not None:
        if not identity.is_server:
            raise ValueError(f"{identity.folder}: {identity.role} lets nobody in: use drone")
        settings["access_control"] = access_control()
    return secured(settings, identity)


def outsider(endpoint: str, identity: Identity | None = None) -> dict[str, Any]:
    """Return the settings of a client of the gateway on `endpoint`, as which role with `identity`.

    Raises:
        ValueError: the identity is a vehicle's.
    """
    if identity is not None and identity.is_server:
        raise ValueError(f"{identity.folder}: a vehicle's certificate dials nobody: use another")
    settings = _settings("client", [], [endpoint])
    settings["connect"]["timeout_ms"] = 5000
    settings["connect"]["exit_on_failure"] = True
    return secured(settings, identity)


def remote(
    vehicle: str, video: str | None = None, identity: Identity | None = None
) -> RemoteSettings:
    """Return the settings of a process that serves the robot from another host.

    Args:
        vehicle: address of the vehicle's router, `host:port`.
        video: address of its link for video; None: the same, and pictures may delay commands.
        identity: certificates of this host's role; None: plain TCP.

    Raises:
        ValueError: the identity is a vehicle's.
    """
    control, bulk = endpoint(vehicle, identity), endpoint(video or vehicle, identity)
    return RemoteSettings(
        _persistent(outsider(control, identity)),
        _persistent(outsider(_small_buffer(bulk), identity)),
    )


def _persistent(settings: dict[str, Any]) -> dict[str, Any]:
    settings["connect"]["timeout_ms"] = OPEN_TIMEOUT_MS
    settings["transport"]["unicast"] = {"open_timeout": OPEN_TIMEOUT_MS}
    settings["transport"]["link"]["tx"]["lease"] = REMOTE_LEASE_MS
    return settings


def _small_buffer(endpoint: str) -> str:
    return f"{endpoint}#so_sndbuf={VIDEO_BUFFER}"


def secured(settings: dict[str, Any], identity: Identity | None) -> dict[str, Any]:
    """Return `settings` with the certificates of `identity` for its TLS links."""
    if identity is None:
        return settings
    link = settings["transport"]["link"] | {"tls": identity.tls()}
    return settings | {"transport": settings["transport"] | {"link": link}}


def endpoint(address: str, identity: Identity | None = None) -> str:
    """Return the Zenoh endpoint of `address`, `host:port` or with its protocol already."""
    if "/" in address:
        return address
    return f"{'tcp' if identity is None else 'tls'}/{address}"


def is_loopback(address: str) -> bool:
    """Return whether `address` (a host, or `host:port`) is reached from this host only."""
    host = address.rsplit("/", 1)[-1]
    if host.count(":") == 1 or host.startswith("["):
        host = host.rpartition(":")[0]
    try:
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return host == "localhost"


def foreign(endpoint: str) -> dict[str, Any]:
    """Return the settings of a session with a router of somebody else's network, as ROS 2's."""
    return _settings("peer", [], [endpoint])
