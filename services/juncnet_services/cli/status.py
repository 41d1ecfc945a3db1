"""`juncnet status`: how each process of the running flights is doing.

Exits 0 when at least one flight runs and all its processes run and report, else 1.
"""

import argparse
import json
import time
from collections.abc import Mapping, Sequence
from typing import Literal

from pydantic import BaseModel, ConfigDict
from rich.console import Console
from rich.table import Table

from juncnet.bus import Inbox
from juncnet.clocks import NS_PER_S, Instant, age_s
from juncnet.flight import Flight
from juncnet.launch import connect
from juncnet.messages import Health, RemoteClock
from juncnet.topics import health_topic
from juncnet_services.cli.local_flights import running_flights
from juncnet_services.cli.supervise import ProcessStatus, Supervisor

LISTEN_S = 2.5
"""Health comes once a second."""
FRESH_S = 3.0
"""A process that has not reported its health for this long is not well."""
COLUMNS = (
    ("process", "state"),
    ("pid", "up", "rate", "age ms", "p50 ms", "p99 ms", "drops", "errors", "restarts"),
)
"""Left-aligned, then right-aligned."""
LEAST_WIDTH = 110
"""Of the output, characters: a pipe or a narrow terminal must not cut figures."""


class Row(BaseModel):
    """One process: what the supervisor says of it, and what it says of itself."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    process: str
    state: str
    """The supervisor's word, in lower case: running, starting, backoff, exited, ..."""
    pid: int
    uptime_s: float
    restarts: int
    fresh: bool
    """Whether it has reported its health within the last seconds."""
    health: Health | None
    """Its newest report; None: it was not heard."""

    @property
    def well(self) -> bool:
        """Whether the process runs and reports."""
        return self.state == "running" and self.fresh


class FlightStatus(BaseModel):
    """One flight and its processes."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    flight: str
    directory: str
    robot: str
    well: bool
    """Whether all its processes are."""
    processes: tuple[Row, ...]


def rows(
    names: Sequence[str],
    statuses: Sequence[ProcessStatus],
    restarts: Mapping[str, int],
    healths: Mapping[str, Health],
    now: Instant,
) -> tuple[Row, ...]:
    """Return a row a process, in the order of `names`; `now` is on the clock of this host."""
    by_name = {status.name: status for status in statuses}

    def row(name: str) -> Row:
        status = by_name.get(name, ProcessStatus(name, "UNKNOWN", 0, 0.0))
        health = healths.get(name)
        age = None if health is None else age_s(health.at.instant, now)
        return Row(
            process=name,
            state=status.state.lower(),
            pid=status.pid,
            uptime_s=status.uptime_s,
            restarts=restarts.get(name, 0),
            fresh=age is not None and age <= FRESH_S,
            health=health,
        )

    return tuple(row(name) for name in names)


def look(flight: Flight) -> FlightStatus:
    """Listen to a flight until all its processes were heard, `LISTEN_S` at most."""
    supervisor = Supervisor(flight.directory)
    statuses, healths = supervisor.status(), dict[str, Health]()
    now = Instant(time.monotonic_ns(), "")
    try:
        with connect(flight.directory) as bus:
            inboxes: dict[str, Inbox[Health]] = {
                name: bus.subscribe(health_topic(name)) for name in flight.processes
            }
            deadline = time.monotonic() + LISTEN_S
            while len(healths) < len(inboxes) and time.monotonic() < deadline and bus.running:
                bus.wait(0.2)
                for name, inbox in inboxes.items():
                    for _, health in inbox.drain():
                        healths[name] = health
            now = Instant(bus.clock.now_ns(), bus.clock.id)
    except ConnectionError:
        pass  # none of its processes listens: the rows say so
    processes = rows(flight.processes, statuses, supervisor.restarts(), healths, now)
    return FlightStatus(
        flight=flight.id,
        directory=str(flight.directory),
        robot=flight.robot,
        well=all(row.well for row in processes),
        processes=processes,
    )


def table(status: FlightStatus) -> Table:
    """Return the rows of a flight as a table for people."""
    result = Table(box=None, padding=(0, 1))
    sides: tuple[Literal["left", "right"], ...] = ("left", "right")
    for side, names in zip(sides, COLUMNS, strict=True):
        for name in names:
            result.add_column(name, justify=side, no_wrap=True)
    for row in status.processes:
        health = row.health
        result.add_row(
            row.process,
            row.state if row.fresh or row.state != "running" else "running, silent",
            str(row.pid or "-"),
            f"{row.uptime_s:.0f} s",
            "-" if health is None else f"{health.rate_hz:.1f}",
            _number(None if health is None or health.age_s is None else 1e3 * health.age_s),
            _number(None if health is None else health.latency_p50_ms),
            _number(None if health is None else health.latency_p99_ms),
            "-" if health is None else str(health.drops),
            "-" if health is None else str(health.errors),
            str(row.restarts),
            style=None if row.well else "red",
        )
    return result


def links(status: FlightStatus) -> list[str]:
    """Return what there is to say of other hosts: links that are down, and their clocks."""
    lines: list[str] = []
    for row in status.processes:
        health = row.health
        if health is None:
            continue
        if health.linked is False:
            lines.append(f" {row.process}: the vehicle's router is not reached")
        for clock, known in health.clocks.items():
            lines.append(f" {row.process}: clock {clock} {_offset(known)}")
    return lines


def _offset(clock: RemoteClock) -> str:
    if clock.offset_ns is None or clock.uncertainty_ns is None:
        return "has an unknown offset: what it stamps counts as stale"
    ahead_s, uncertainty_ms = clock.offset_ns / NS_PER_S, clock.uncertainty_ns / 1e6
    return f"is {ahead_s:+.4f} s ahead of this host's, within {uncertainty_ms:.2f} ms"


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.1f}"


def main(argv: list[str]) -> int:
    """Print the status of the running flights."""
    parser = argparse.ArgumentParser(prog="juncnet status", description=__doc__)
    parser.add_argument("--json", action="store_true", help="a list of flights")
    parser.add_argument("--robot", help="of this robot only (default: of every robot)")
    options = parser.parse_args(argv)
    found = [look(flight) for flight in running_flights(options.robot)]
    if options.json:
        print(json.dumps([status.model_dump(mode="json") for status in found], indent=2))
    elif not found:
        print("nothing is up")
    else:
        console = Console(width=max(LEAST_WIDTH, Console().width))
        for status in found:
            console.print(f"robot {status.robot}, flight {status.directory}")
            console.print(table(status))
            for line in links(status):
                console.print(line, markup=False, highlight=False)
            for row in status.processes:
                if row.health is not None and row.health.last_error:
                    console.print(f" {row.process}: {row.health.last_error}", markup=False)
    return 0 if found and all(status.well for status in found) else 1
