"""`juncnet up [LAYOUT]`: starts a layout in the background and waits until every process works.

Exits 0 when all processes have reported their health, 1 when one did not (the text says which, and
shows the end of its log), 2 when the layout is wrong or the robot is up already.
"""

import argparse
import json
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from juncnet.assets import asset_path
from juncnet.bus import Inbox
from juncnet.flight import Flight, new_flight
from juncnet.launch import connect
from juncnet.layout import OPTIONAL, SAVED, Layout, LayoutError, load_layout
from juncnet.messages import Health
from juncnet.topics import health_topic
from juncnet_services.cli.local_flights import UP_MARK, end, running_flights, started_by_up
from juncnet_services.cli.supervise import ProcessStatus, Supervisor
from juncnet_services.dashboard.service import DASHBOARD, page_url
from juncnet_services.dashboard.service import Config as PageConfig

TIMEOUT_S = 60.0
ENDED = ("EXITED", "FATAL", "STOPPED", "UNKNOWN")
MAX_RESTARTS = 3
"""A process that was started again this often before it reported health will not work."""
LOG_LINES = 15


def hopeless(
    silent: Sequence[str], statuses: Sequence[ProcessStatus], restarts: dict[str, int]
) -> list[str]:
    """Return those of the `silent` processes for which waiting is of no use."""
    ended = {status.name for status in statuses if status.state in ENDED}
    return [n for n in silent if n in ended or restarts.get(n, 0) >= MAX_RESTARTS]


def wait_for_health(flight: Flight, supervisor: Supervisor, timeout_s: float) -> list[str]:
    """Wait until every process has reported its health, and return those that have not.

    Does not wait for those that cannot: they have ended, or end again and again.
    """
    deadline = time.monotonic() + timeout_s
    with connect(flight.directory, timeout_s=timeout_s) as bus:
        inboxes: dict[str, Inbox[Health]] = {
            name: bus.subscribe(health_topic(name)) for name in flight.processes
        }
        while True:
            silent = [name for name, inbox in inboxes.items() if inbox.newest is None]
            late = time.monotonic() > deadline or not bus.running
            lost = hopeless(silent, supervisor.status(), supervisor.restarts())
            if late or len(lost) == len(silent):
                return silent
            bus.wait(0.2)
            for inbox in inboxes.values():
                inbox.drain()


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


def failure_text(flight: Flight, supervisor: Supervisor, silent: Sequence[str]) -> str:
    """Return which processes did not report health, their state and the end of their logs."""
    states = {status.name: status.state for status in supervisor.status()}
    lines = [f"{len(silent)} of {len(flight.processes)} processes did not report their health:"]
    for name in silent:
        lines += [f"  {name} ({states.get(name, 'unknown').lower()}), the end of its log:"]
        lines += [log_end(flight.directory, name)]
    return "\n".join(lines)


def none_text(flight: Flight, supervisor: Supervisor, error: Exception) -> str:
    """Return why no process of the flight could be reached, as far as the logs tell."""
    return "\n".join(
        [
            str(error),
            failure_text(flight, supervisor, flight.processes),
            "the end of the supervisor's log:",
            log_end(flight.directory, "supervisord"),
            f"all were stopped; their logs are in {flight.directory}",
        ]
    )


def success_text(flight: Flight) -> str:
    """Return where the flight is, how outsiders get in, and how to stop it."""
    endpoint = flight.directory / "router.endpoint"
    gateway = endpoint.read_text().strip() if endpoint.exists() else "none in this layout"
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
        silent = wait_for_health(flight, supervisor, options.timeout)
    except ConnectionError as error:
        text = none_text(flight, supervisor, error)
        end(flight, keep=True)
        print(f"juncnet up: {text}", file=sys.stderr)
        return 1
    if silent:
        print(f"juncnet up: {failure_text(flight, supervisor, silent)}", file=sys.stderr)
    print(success_text(flight))
    return 1 if silent else 0
