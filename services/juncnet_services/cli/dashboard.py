"""`juncnet dashboard`: one page that shows robots and commands them, until Ctrl-C.

Shows every flight that runs on this host, or what is named with --connect. The address that is
printed has a key behind the #: who has it commands. With --view-only nobody does.
"""

import argparse
import contextlib
import sys
import threading
import time
from collections.abc import Sequence
from pathlib import Path

from juncnet.assets import asset_path
from juncnet.flight import HostClock
from juncnet.launch import connect
from juncnet.layout import SAVED, LayoutError, load_layout
from juncnet.priority import give_way
from juncnet.zenoh_bus import ZenohBus
from juncnet_services.cli.local_flights import running_flights
from juncnet_services.cli.ranges import port
from juncnet_services.dashboard import NICENESS
from juncnet_services.dashboard.access import Right, new_address
from juncnet_services.dashboard.board import Board, listen
from juncnet_services.dashboard.pages import served
from juncnet_services.dashboard.service import DASHBOARD, Config, about

POLL_S = 0.5


def targets(named: Sequence[str], robots: Sequence[str]) -> list[str]:
    """Return what to connect to: what is named, else the newest running flight of each robot.

    Raises:
        FileNotFoundError: no flight runs here.
    """
    if named:
        return list(named)
    newest = {flight.robot: str(flight.directory) for flight in running_flights()}
    wanted = [target for robot, target in newest.items() if not robots or robot in robots]
    if not wanted:
        whose = f" of robot {', '.join(robots)}" if robots else ""
        raise FileNotFoundError(f"no flight{whose} runs here: start one, or name one by --connect")
    return wanted


def configuration(options: argparse.Namespace, first: str) -> Config:
    """Return the options of the page: of `--layout`, else of the layout that the flight runs.

    Raises:
        LayoutError: an option is wrong.
        FileNotFoundError: there is no such layout.
    """
    saved = Path(first) / SAVED
    if options.layout is None and saved.exists():
        layout = load_layout(saved, options.set)
    else:
        layout = load_layout(asset_path(options.layout or "local", "layouts", ".toml"), options.set)
    config = layout.section(DASHBOARD, Config)
    changes = {"port": options.port, "view_only": options.view_only or config.view_only}
    return config.model_copy(update={k: v for k, v in changes.items() if v is not None})


def serve(buses: Sequence[ZenohBus], robots: Sequence[str], config: Config) -> None:
    """Serve the page until every bus has stopped or the user interrupts.

    Raises:
        OSError: the port is taken.
    """
    give_way(NICENESS)
    board, address = Board(HostClock(), config.camera, robots), new_address(config.port)
    right = Right.WATCH if config.view_only else Right.COMMAND
    with served(board, address, about(config, buses[0])):
        print(f"dashboard: {address.url(right)}", flush=True)
        if right is Right.COMMAND:
            print(f"to watch:  {address.url(Right.WATCH)}", flush=True)
        for bus in buses:
            threading.Thread(target=listen, args=(bus, board), daemon=True).start()
        with contextlib.suppress(KeyboardInterrupt):
            while any(bus.running for bus in buses):
                time.sleep(POLL_S)


def arguments(argv: list[str]) -> argparse.Namespace:
    """Return the parsed command line."""
    parser = argparse.ArgumentParser(
        prog="juncnet dashboard",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--robot", action="append", default=[], help="only this one; repeatable")
    parser.add_argument(
        "--connect",
        action="append",
        default=[],
        metavar="HOST:PORT|DIR",
        help="a gateway or a flight directory; repeatable (default: all flights on this host)",
    )
    parser.add_argument("--port", type=port, help="on the loopback interface (default: a free one)")
    parser.add_argument("--view-only", action="store_true", help="the page cannot command")
    parser.add_argument("--layout", help="whose options count (default: the flight's)")
    parser.add_argument(
        "--set", action="append", default=[], metavar="SECTION.OPTION=VALUE", help="repeatable"
    )
    return parser.parse_args(argv)


def main(argv: list[str]) -> int:
    """Serve until interrupted; 1 when there is nothing to show, 2 for wrong options."""
    options = arguments(argv)
    try:
        wanted = targets(options.connect, options.robot)
        config = configuration(options, wanted[0])
        with contextlib.ExitStack() as stack:
            robot = options.robot[0] if options.robot else None
            buses = [
                stack.enter_context(connect(target, None if Path(target).is_dir() else robot))
                for target in wanted
            ]
            serve(buses, options.robot, config)
    except LayoutError as error:
        print(f"juncnet dashboard: {error}", file=sys.stderr)
        return 2
    except OSError as error:  # nobody there, no flight, no layout of this name, port taken
        print(f"juncnet dashboard: {error}", file=sys.stderr)
        return 1
    return 0
