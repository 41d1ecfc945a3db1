"""How the processes of a flight are linked: Zenoh settings, as plain data.

A full mesh of peers over Unix sockets in the flight's directory. Every process listens on a socket
of its own and dials all others, so a restarted one is heard as soon as it runs (measured: first
message 5-20 ms after its session opens, and 4 ms to open it) and the death of one cuts nobody
else's link. Both ends dial: that costs nothing (one link is kept, no message comes twice) and
saves waiting for a redial. A gateway, Zenoh in router mode, joins the mesh for outsiders on TCP.

`scouting.delay` 0 matters: without it every start waits 0.5 s for scouting that is switched off.
"""

from typing import Any

from juncnet.flight import Flight

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


def gateway(flight: Flight, endpoint: str) -> dict[str, Any]:
    """Return the settings of the router that lets outsiders in on `endpoint`."""
    return _settings("router", [flight.socket(GATEWAY), endpoint], _others(flight, GATEWAY))


def outsider(endpoint: str) -> dict[str, Any]:
    """Return the settings of a client of the gateway on `endpoint`."""
    settings = _settings("client", [], [endpoint])
    settings["connect"]["timeout_ms"] = 5000
    settings["connect"]["exit_on_failure"] = True
    return settings
