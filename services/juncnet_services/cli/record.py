"""`juncnet record`: every topic of a robot to MCAP files, until Ctrl-C or the end of the flight.

Foxglove and Rerun open them; `juncnet replay` and `juncnet report` read them. The files are
FOLDER/<flight>-000.mcap, -001 and so on.
"""

import argparse
import signal
import sys
import threading
import time
from pathlib import Path
from types import FrameType

from juncnet.launch import connect
from juncnet.priority import give_way
from juncnet.recording import MISSING
from juncnet.zenoh_bus import ZenohBus
from juncnet_services.cli.events import newest_flight
from juncnet_services.cli.ranges import positive, whole

POLL_S = 0.5


def main(argv: list[str]) -> int:
    """Record; 1 when there is no flight, 2 for bad arguments or when the extra is missing."""
    try:
        from juncnet_services.recorder.service import NICENESS, Config, run
    except ImportError as error:
        print(f"juncnet record: {MISSING} ({error})", file=sys.stderr)
        return 2
    options = _arguments(argv)
    config = Config(
        folder=options.out,
        split_mb=options.split_mb,
        video=not options.no_video,
        max_width=options.max_width,
        features=options.features,
    )
    give_way(NICENESS)
    try:
        target = options.connect or newest_flight(options.robot)
        with connect(target, options.robot) as bus:
            _stop_when_over(bus, Path(target), options.limit)
            print(f"recording robot {bus.robot} to {config.folder}; Ctrl-C ends", file=sys.stderr)
            run(bus, config)
    except (ConnectionError, OSError) as error:
        print(f"juncnet record: {error}", file=sys.stderr)
        return 1
    return 0


def _arguments(argv: list[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="juncnet record", description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("recordings"), help="folder")
    parser.add_argument(
        "--robot", help="its name (default: the newest flight's; by a router: robot)"
    )
    parser.add_argument(
        "--connect",
        metavar="HOST:PORT|DIR",
        help="a gateway or a flight directory (default: the newest flight on this host)",
    )
    parser.add_argument(
        "--split-mb", type=whole(1), default=1000, help="size of a file (default 1000)"
    )
    parser.add_argument("--no-video", action="store_true", help="leave camera/frame out")
    parser.add_argument(
        "--max-width",
        type=whole(2, 16384),
        default=960,
        metavar="PX",
        help="of video that is encoded here; a camera's own stays as it is (default 960)",
    )
    parser.add_argument("--features", action="store_true", help="record radon/features too")
    parser.add_argument("--for", type=positive, dest="limit", metavar="SECONDS", help="end after")
    return parser.parse_args(argv)


def _stop_when_over(bus: ZenohBus, flight: Path, limit_s: float | None) -> None:
    """Stop the bus on a signal, after `limit_s`, or when the local flight's directory is gone."""

    def on_signal(_number: int, _frame: FrameType | None) -> None:
        bus.stop()

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, on_signal)
    local, began = flight.is_dir(), time.monotonic()

    def watch() -> None:
        while bus.running:
            over = limit_s is not None and time.monotonic() - began > limit_s
            if over or (local and not (flight / "flight.json").exists()):
                bus.stop()
            time.sleep(POLL_S)

    threading.Thread(target=watch, name="watch", daemon=True).start()
