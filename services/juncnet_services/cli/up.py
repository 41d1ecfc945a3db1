"""`juncnet up [LAYOUT]`: starts a layout in the background and waits until every process works.

Exits 0 when all processes have reported their health, 1 when one did not or, at once, when one will
not work (the text says which, and shows the end of its log), 2 when the layout is wrong or the
robot is up already.
"""

import argparse
import json
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from juncnet.assets import asset_path
from juncnet.bus import Bus, Inbox
from juncnet.flight import Flight, new_flight
from juncnet.launch import connect
from juncnet.layout import OPTIONAL, SAVED, Layout, LayoutError, load_layout
from juncnet.messages import Health
from juncnet.topics import health_topic
from juncnet.zenoh_bus import ZenohBus
from juncnet_services.cli.local_flights import UP_MARK, end, running_flights, started_by_up
from juncnet_services.cli.supervise import ProcessStatus, Supervisor
from juncnet_services.dashboard.service import DASHBOARD, page_url
from juncnet_services.dashboard.service import Config as PageConfig

TIMEOUT_S = 60.0
ENDED = ("EXITED", "FATAL", "STOPPED", "UNKNOWN")
MAX_RESTARTS = 3
"""A process that was started again this often before it reported health will not work."""
LOG_LINES = 15
ATTEMPT_S = 1.0
"""To reach the first process, before its supervisor is asked whether there will be one."""


@dataclass(frozen=True)
class Waited:
    """Which processes will not work, and which of the others had not reported their health."""

    failed: tuple[str, ...]
    silent: tuple[str, ...]


def hopeless(
    silent: Sequence[str], statuses: Sequence[ProcessStatus], restarts: dict[str, int]
) -> list[str]:
    """Return those of the `silent` processes for which waiting is of no use."""
    ended = {status.name for status in statuses if status.state in ENDED}
    return [n for n in silent if n in ended or restarts.get(n, 0) >= MAX_RESTARTS]


def wait_for_health(flight: Flight, supervisor: Supervisor, timeout_s: float) -> Waited:
    """Wait until every process has reported its health, or one will not work.

    Raises:
        ConnectionError: no process could be reached, and none will be or time is over.
    """
    deadline_s = time.monotonic() + timeout_s
    with reach(flight, supervisor, deadline_s) as bus:
        return listen(bus, flight, supervisor, deadline_s)


def reach(flight: Flight, supervisor: Supervisor, deadline_s: float) -> ZenohBus:
    """Return a bus to the flight, as soon as one of its processes is there.

    Raises:
        ConnectionError: none of them will work, time is over, or it is not a matter of time.
    """
    while True:
        began_s = time.monotonic()
        attempt_s = max(0.0, min(ATTEMPT_S, deadline_s - began_s))
        try:
            return connect(flight.directory, timeout_s=attempt_s)
        except ConnectionError:
            now_s = time.monotonic()
            if now_s >= deadline_s or now_s - began_s < attempt_s:
                raise
            if not judged(flight.processes, supervisor).silent:
                raise


def listen(bus: Bus, flight: Flight, supervisor: Supervisor, deadline_s: float) -> Waited:
    """Return which processes had not reported when all had, one will not work, or time is over."""
    inboxes: dict[str, Inbox[Health]] = {
        name: bus.subscribe(health_topic(name)) for name in flight.processes
    }
    while True:
        silent = [name for name, inbox in inboxes.items() if inbox.newest is None]
        waited = judged(silent, supervisor)
        if not silent or waited.failed or time.monotonic() > deadline_s or not bus.running:
            return waited
        bus.wait(0.2)
        for inbox in inboxes.values():
            inbox.drain()


def judged(silent: Sequence[str], supervisor: Supervisor) -> Waited:
    """Return those of the `silent` processes that will not work, and the others."""
    failed = hopeless(silent, supervisor.status(), supervisor.restarts())
    return Waited(tuple(failed), tuple(name for name in silent if name not in failed))


def start(layout: Layout, settings: Sequence[str]) -> tuple[Flight, Supervisor]:
    """Start the processes of a layout as a new flight, detached.

    Raises:
        RuntimeError: the supervisor did not start; none is left behind.
    """
    flight = new_flight(layout.launch.robot, layout.processes)
    mark = {"layout": str(layout.path), "settings": list(settings), "directory": str(Path.cwd())}
    (flight.directory / UP_MARK).write_text(json.dumps(mark, indent=2) + "\n")
    layout.save(flight.directory / SAVED)
    arguments = ["--layout", str(layout.path), "--flight-dir", str(flight.directory)]
    for setting in settings:
        arguments += ["--set", setting]
    supervisor = Supervisor(flight.directory)
    try:
        supervisor.start(layout.processes, arguments, foreground=False)
    except BaseException:  # interrupted too
        supervisor.stop()
        end(flight, keep=True)
        raise
    return flight, supervisor


def log_end(directory: Path, process: str) -> str:
    """Return the last lines of a process's log, indented."""
    log = directory / f"{process}.log"
    lines = log.read_text(errors="replace").splitlines() if log.exists() else []
    return "\n".join(f"    {line}" for line in lines[-LOG_LINES:]) or "    it wrote no log"


def failure_text(flight: Flight, supervisor: Supervisor, waited: Waited) -> str:
    """Return which processes did not come up, their state and the end of their logs."""
    states = {status.name: status.state for status in supervisor.status()}
    names, became = waited.silent, "did not report their health"
    if waited.failed:
        names, became = waited.failed, "will not work"
    lines = [f"{len(names)} of {len(flight.processes)} processes {became}:"]
    for name in names:
        lines += [f"  {name} ({states.get(name, 'unknown').lower()}), the end of its log:"]
        lines += [log_end(flight.directory, name)]
    if waited.failed and waited.silent:
        lines += [f"not waited for any longer: {', '.join(waited.silent)}"]
    return "\n".join(lines)


def none_text(flight: Flight, supervisor: Supervisor, error: Exception) -> str:
    """Return why no process of the flight could be reached, as far as the logs tell."""
    return "\n".join(
        [
            str(error),
            failure_text(flight, supervisor, judged(flight.processes, supervisor)),
            "the end of the supervisor's log:",
            log_end(flight.directory, "supervisord"),
            f"all were stopped; their logs are in {flight.directory}",
        ]
    )


def success_text(flight: Flight) -> str:
    """Return where the flight is, how outsiders get in, and how to stop it."""
    endpoint = flight.directory / "router.endpoint"
    missing = "not open yet" if "router" in flight.processes else "none in this layout"
    gateway = endpoint.read_text().strip() if endpoint.exists() else missing
    lines = [
        f"robot     {flight.robot}",
        f"flight    {flight.directory}",
        f"gateway   {gateway}",
        f"stop      juncnet down --robot {flight.robot}",
    ]
    if DASHBOARD in flight.processes:
        page = load_layout(flight.directory / SAVED).section(DASHBOARD, PageConfig)
        lines.append(f"dashboard {page_url(flight.directory, page)}")
    return "\n".join(lines)


def arguments(argv: list[str]) -> argparse.Namespace:
    """Return the parsed command line."""
    parser = argparse.ArgumentParser(prog="juncnet up", description=__doc__)
    parser.add_argument("layout", nargs="?", default="local", help="file or built-in (local)")
    parser.add_argument(
        "--set", action="append", default=[], metavar="SECTION.OPTION=VALUE", help="repeatable"
    )
    parser.add_argument(
        "--with",
        action="append",
        default=[],
        choices=OPTIONAL,
        dest="beside",
        help="start it beside the processes of the layout; repeatable",
    )
    parser.add_argument(
        "--force", action="store_true", help="start even if a flight of this robot is up"
    )
    parser.add_argument(
        "--timeout", type=float, default=TIMEOUT_S, metavar="SECONDS", help="to wait for health"
    )
    return parser.parse_args(argv)


def main(argv: list[str]) -> int:
    """Start, wait, and say how it went."""
    options = arguments(argv)
    try:
        path = asset_path(options.layout, "layouts", ".toml").resolve()
        layout = load_layout(path, options.set).beside(*options.beside)
        layout.validate_all()
    except (LayoutError, ValueError, OSError) as error:
        print(f"juncnet up: {error}", file=sys.stderr)
        return 2
    robot = layout.launch.robot
    up = [flight for flight in running_flights(robot) if started_by_up(flight)]
    if up and not options.force:
        print(
            f"juncnet up: robot {robot!r} is up already, in {up[-1].directory}: stop it with\n"
            f"    juncnet down --robot {robot}\n"
            "or name another robot with --set launch.robot=NAME, or start it beside with --force",
            file=sys.stderr,
        )
        return 2
    try:
        flight, supervisor = start(layout, options.set)
    except RuntimeError as error:
        print(f"juncnet up: {error}", file=sys.stderr)
        return 1
    try:
        waited = wait_for_health(flight, supervisor, options.timeout)
    except ConnectionError as error:
        text = none_text(flight, supervisor, error)
        end(flight, keep=True)
        print(f"juncnet up: {text}", file=sys.stderr)
        return 1
    well = waited == Waited((), ())
    if not well:
        print(f"juncnet up: {failure_text(flight, supervisor, waited)}", file=sys.stderr)
    print(success_text(flight))
    return 0 if well else 1
