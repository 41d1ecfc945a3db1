"""The flights of this user on this host: which there are, which run, how one is ended for good."""

import contextlib
import os
import shutil
import signal
import socket
import time
from pathlib import Path

from juncnet.access import VEHICLE_SIDE
from juncnet.flight import Flight, flights_root, read_flight
from juncnet.layout import SAVED, LayoutError, load_layout
from juncnet_services.cli.supervise import Supervisor

UP_MARK = "up.json"
"""A flight with this file was started by `juncnet up`; the others belong to a running command."""
TERM_WAIT_S = 5.0


def all_flights(robot: str | None = None) -> list[Flight]:
    """Return the flights, of this robot only if one is named, oldest first."""
    flights: list[Flight] = []
    for path in sorted(flights_root().glob("*/flight.json"), key=_made):
        with contextlib.suppress(OSError, ValueError, KeyError):
            flights.append(read_flight(path.parent))
    return [flight for flight in flights if robot in (None, flight.robot)]


def _made(path: Path) -> float:
    try:
        return path.stat().st_mtime
    except FileNotFoundError:  # a flight that ends at this moment
        return 0.0


def is_running(flight: Flight) -> bool:
    """Return whether the flight's supervisor answers, or any of its processes lives without it."""
    return Supervisor(flight.directory).running or bool(pids_of(flight))


def running_flights(robot: str | None = None) -> list[Flight]:
    """Return the flights that run, of this robot only if one is named, oldest first."""
    return [flight for flight in all_flights(robot) if is_running(flight)]


def listens(flight: Flight) -> bool:
    """Return whether a process of the flight lets others in, whoever started it and however."""
    for process in flight.processes:
        with socket.socket(socket.AF_UNIX) as probe:
            probe.setblocking(False)
            try:
                probe.connect(str(flight.socket_path(process)))
            except BlockingIOError:  # it is there, and hangs
                return True
            except OSError:
                continue
            return True
    return False


def commands_vehicle(flight: Flight) -> bool:
    """Return whether an order can reach a vehicle through the flight: no replay has one."""
    if VEHICLE_SIDE in flight.processes:
        return True
    saved = flight.directory / SAVED
    try:
        return saved.exists() and load_layout(saved).links.vehicle is not None
    except LayoutError:
        return True


def flights_to_order(robot: str | None = None) -> list[Flight]:
    """Return the flights that an order can mean, of this robot only if one is named.

    Those that are starting are among them, and those that were started by hand.
    """
    return [f for f in all_flights(robot) if commands_vehicle(f) and (listens(f) or is_running(f))]


def started_by_up(flight: Flight) -> bool:
    """Return whether `juncnet up` started the flight."""
    return (flight.directory / UP_MARK).exists()


def pids_of(flight: Flight) -> list[int]:
    """Return the processes of the flight's services, found by their command lines in /proc."""
    wanted = str(flight.directory).encode()
    pids: list[int] = []
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            words = path.read_bytes().split(b"\0")
        except OSError:  # it has ended
            continue
        if b"--flight-dir" in words[:-1] and words[words.index(b"--flight-dir") + 1] == wanted:
            pids.append(int(path.parent.name))
    return pids


def end(flight: Flight, keep: bool) -> None:
    """Stop all processes of the flight, and remove its directory unless `keep`."""
    Supervisor(flight.directory).stop()
    for number in (signal.SIGTERM, signal.SIGKILL):
        for pid in pids_of(flight):
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, number)
        deadline = time.monotonic() + TERM_WAIT_S
        while pids_of(flight) and time.monotonic() < deadline:
            time.sleep(0.05)
    (flight.directory / UP_MARK).unlink(missing_ok=True)
    if not keep:
        shutil.rmtree(flight.directory, ignore_errors=True)
