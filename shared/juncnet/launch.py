"""What every process needs before its `run`: configuration, logging, signals, session, health.

`main()` of a service is one line: `launch(run, Config)`. A tool joins a flight with `connect`.
"""

import argparse
import contextlib
import json
import logging
import os
import re
import signal
import sys
import time
from collections.abc import Callable, Generator
from pathlib import Path
from types import FrameType
from typing import Any, TypeVar

import zenoh
from pydantic import BaseModel

from juncnet import links
from juncnet.assets import asset_path
from juncnet.bus import Bus
from juncnet.flight import Flight, join_flight, new_flight, read_flight
from juncnet.frame_ports import FrameTransport
from juncnet.identity import CERTIFICATES_VARIABLE, Identity, read_identity
from juncnet.layout import SAVED, Layout, LayoutError, LinksOptions, load_layout
from juncnet.links import RemoteSettings
from juncnet.zenoh_bus import ZenohBus

C = TypeVar("C", bound=BaseModel)
FLIGHT_VARIABLE = "JUNCNET_FLIGHT"
"""Environment variable with the flight directory, for processes that a supervisor starts."""
DEFAULT_ROBOT = "robot"
"""As layouts call it that give no name."""
NOWHERE = Path(os.devnull)
"""The directory of who is no part of a flight: nothing can be read or written in it."""
MISCONFIGURED = 2
"""Exit code of a process that will not work however often it is started."""
SUPERVISOR_START_S = 1.5
"""A little longer than `startsecs` in juncnet_services.cli.supervise."""
LOG_FORMAT = "%(asctime)s.%(msecs)03d %(levelname)-7s %(name)s: %(message)s"


def launch(run: Callable[[Bus, C], None], config: type[C]) -> None:
    """Run a service until it ends or is told to, then exit: 0 clean, 1 failed, 2 misconfigured."""
    with _end_seen_by_supervisor():
        service = _package(run.__module__)
        options = _arguments(service)
        try:
            layout = load_layout(asset_path(options.layout, "layouts", ".toml"), options.set)
            section = layout.section(service, config)
            flight = _flight(layout, options.flight_dir)
            remote = remote_settings(layout.links)
        except (LayoutError, ValueError, OSError) as error:
            print(error, file=sys.stderr)
            sys.exit(MISCONFIGURED)
        _set_up_process(layout)
        sys.exit(_run(run, section, layout, (flight, remote), service))


@contextlib.contextmanager
def _end_seen_by_supervisor() -> Generator[None]:
    """Delay the end of a misconfigured process until its supervisor takes it for what it is.

    supervisord starts anew whatever ends within its first second, without a look at the code.
    """
    began = time.monotonic()
    try:
        yield
    except SystemExit as end:
        if end.code == MISCONFIGURED and "SUPERVISOR_ENABLED" in os.environ:
            time.sleep(max(0.0, began + SUPERVISOR_START_S - time.monotonic()))
        raise


def _run(
    run: Callable[[Bus, C], None],
    section: C,
    layout: Layout,
    joined: tuple[Flight, RemoteSettings | None],
    service: str,
) -> int:
    log = logging.getLogger(service)
    layout.state_dir.mkdir(mode=0o700, parents=True, exist_ok=True)
    flight, remote = joined
    settings, frames = links.member(flight, service), layout.bus.frames
    with ZenohBus(settings, flight, service, layout.state_dir, frames, remote) as bus:
        _stop_on_signals(bus)
        bus.report_health()
        log.info("flight %s, robot %s, pid %d", flight.id, flight.robot, os.getpid())
        try:
            run(bus, section)
        except Exception:
            log.exception("failed")
            return 1
        log.info("ended")
    return 0


def _stop_on_signals(bus: ZenohBus) -> None:
    def stop(_number: int, _frame: FrameType | None) -> None:
        bus.stop()

    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, stop)


@contextlib.contextmanager
def open_gateway(
    flight: Flight, endpoint: str, identity: Identity | None = None, video: str | None = None
) -> Generator[None]:
    """Let outsiders that dial `endpoint` or `video` into the flight's mesh while the context lasts.

    With an identity they need a certificate of its CA, and may do what their role may.
    """
    settings = links.gateway(flight, endpoint, identity, video)
    with zenoh.open(zenoh.Config.from_json5(json.dumps(settings))):
        yield


def connect(
    target: str | Path,
    robot: str | None = None,
    frames: FrameTransport = "auto",
    timeout_s: float = 5,
    certificates: Path | None = None,
) -> ZenohBus:
    """Return a bus for a tool or a test: `target` is a flight directory or a gateway, `host:port`.

    Through a gateway there are no frames, and `robot` is whom the bus speaks of (default: "robot");
    `certificates` is the folder of a role (default: $JUNCNET_CERTIFICATES, else a plain link).

    Raises:
        ConnectionError: nobody is there, the directory's flight is of another robot than the one
            named, or the certificates cannot be used.
    """
    service, remote = f"cli-{os.getpid()}", None
    if not isinstance(target, Path):  # as `juncnet up` prints it
        target = target.removeprefix("tls/").removeprefix("tcp/")
    if Path(target).is_dir():
        flight = read_flight(Path(target))
        if robot not in (None, flight.robot):
            raise ConnectionError(
                f"{target} is a flight of robot {flight.robot!r}, not {robot!r}: name one of them"
            )
        settings = links.visitor(flight)
        remote = _remote_of(flight, certificates)
    else:
        if str(target).startswith(("/", ".")) or ":" not in str(target):
            raise ConnectionError(f"{target}: neither a flight's directory nor HOST:PORT")
        flight, frames = Flight("outside", NOWHERE, robot or DEFAULT_ROBOT, ()), "none"
        settings = _outsider(str(target), certificates)
    try:
        bus = ZenohBus(settings, flight, service, NOWHERE, frames, remote)
    except zenoh.ZError as error:
        raise ConnectionError(f"{target}: {_unreached(error)}") from error
    deadline = time.monotonic() + timeout_s
    try:
        while not bus.connected:
            if time.monotonic() > deadline:
                raise ConnectionError(f"{target}: no process of this flight is running")
            time.sleep(0.01)
    except BaseException:  # whoever interrupts the wait has no bus to close
        bus.close()
        raise
    return bus


def _unreached(error: zenoh.ZError) -> str:
    """Return what Zenoh says for whoever dialled: without where in its source it says so."""
    if "Unable to connect" in str(error):
        return (
            "no router lets this program in: does the flight run, is this the address that"
            " `juncnet up` printed, and do the certificates, if any, belong to it?"
        )
    return re.sub(r" at /\S+\.rs:\d+", "", str(error))


def remote_settings(options: LinksOptions, folder: Path | None = None) -> RemoteSettings | None:
    """Return how the vehicle is reached, in the role of `folder` or else in the layout's own.

    None where the vehicle is this host.

    Raises:
        ValueError: the certificates cannot be used.
    """
    folder = folder or options.certificates
    identity = None if folder is None else read_identity(folder)
    if options.vehicle is None:
        return None
    return links.remote(options.vehicle, options.video, identity)


def _remote_of(flight: Flight, certificates: Path | None) -> RemoteSettings | None:
    """Return how a visitor of a flight reaches the vehicle, where that is another host."""
    saved = flight.directory / SAVED
    if not saved.exists():
        return None
    named = certificates or os.environ.get(CERTIFICATES_VARIABLE)
    try:
        return remote_settings(load_layout(saved).links, Path(named) if named else None)
    except ValueError as error:
        raise ConnectionError(str(error)) from error


def _outsider(target: str, certificates: Path | None) -> dict[str, Any]:
    named = certificates or os.environ.get(CERTIFICATES_VARIABLE)
    try:
        identity = read_identity(Path(named)) if named else None
        return links.outsider(links.endpoint(target, identity), identity)
    except ValueError as error:
        raise ConnectionError(str(error)) from error


def _package(module: str) -> str:
    """Return the name of the package that holds `module`: a service is called after its folder."""
    if module == "__main__":
        spec = sys.modules["__main__"].__spec__
        module = spec.name if spec is not None else module
    return module.split(".")[-2] if "." in module else module


def _arguments(service: str) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog=service)
    parser.add_argument("--layout", required=True, help="TOML file, or the name of a built-in one")
    parser.add_argument(
        "--set", action="append", default=[], metavar="SECTION.OPTION=VALUE", help="repeatable"
    )
    parser.add_argument(
        "--flight-dir",
        type=Path,
        default=os.environ.get(FLIGHT_VARIABLE),
        help=f"join the flight of this directory (default: ${FLIGHT_VARIABLE}, else a new one)",
    )
    return parser.parse_args()


def _flight(layout: Layout, directory: Path | None) -> Flight:
    if directory is None:
        return new_flight(layout.launch.robot, layout.processes)
    return join_flight(Path(directory), layout.launch.robot, layout.processes)


def _set_up_process(layout: Layout) -> None:
    logging.basicConfig(
        level=layout.launch.log_level.upper(), format=LOG_FORMAT, datefmt="%H:%M:%S"
    )
    # Zenoh leaves the results of its commands without a type.
    zenoh.init_log_from_env_or("error")  # pyright: ignore[reportUnknownMemberType]
