"""How the processes of a flight are linked: Zenoh settings, as plain data.

A full mesh of peers over Unix sockets in the flight's directory. Every process listens on a socket
of its own and dials all others, so a restarted one is heard as soon as it runs (measured: first
message 5-20 ms after its session opens, and 4 ms to open it) and the death of one cuts nobody
else's link. Both ends dial: that costs nothing (one link is kept, no message comes twice) and
saves waiting for a redial. A gateway, Zenoh in router mode, joins the mesh for outsiders on TCP.

With certificates the gateway speaks TLS only, knows who dials by certificate, and denies what that
role may not do. Rights are judged by the certificate of the link on which something comes in, so a
remote tool links to the vehicle's gateway itself, never through another one.

`scouting.delay` 0 matters: without it every start waits 0.5 s for scouting that is switched off.
"""

import ipaddress
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


def gateway(flight: Flight, endpoint: str, identity: Identity | None = None) -> dict[str, Any]:
    """Return the settings of the router that lets outsiders in on `endpoint`.

    With an identity, by certificate and by the rights of their roles; without, whoever comes.

    Raises:
        ValueError: the identity is not a vehicle's.
    """
    settings = _settings("router", [flight.socket(GATEWAY), endpoint], _others(flight, GATEWAY))
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


def is_loopback(host: str) -> bool:
    """Return whether only processes of this host can dial a listener on `host`."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"
