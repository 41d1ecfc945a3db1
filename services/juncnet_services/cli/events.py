"""`juncnet events`: prints junction events as they happen, those so far first, each once.

A restarted navigator repeats its last events: they are told by (flight, index) and left out.
"""

import argparse
import json
import os
import sys
import time
from collections.abc import Iterable
from pathlib import Path

from juncnet.bus import Bus, Inbox
from juncnet.launch import connect
from juncnet.messages import JunctionEvent
from juncnet.topics import JUNCTION_EVENT
from juncnet_services.cli.local_flights import running_flights
from juncnet_services.cli.ranges import positive
from juncnet_services.cli.view import event_text

CAPACITY = 256
WAIT_S = 0.5


class Once:
    """Lets every event pass once, by its robot, flight and index."""

    def __init__(self) -> None:
        self._seen: set[tuple[str, str, int]] = set()

    def news(self, events: Iterable[tuple[str, JunctionEvent]]) -> list[tuple[str, JunctionEvent]]:
        """Return those of `events`, each with its robot, that have not passed before, in order."""
        found: list[tuple[str, JunctionEvent]] = []
        for robot, event in events:
            key = (robot, event.flight, event.index)
            if key not in self._seen:
                self._seen.add(key)
                found.append((robot, event))
        return found


def line(robot: str, event: JunctionEvent, as_json: bool) -> str:
    """Return an event as one line, for people or as a JSON object with the robot's name."""
    if as_json:
        return json.dumps({"robot": robot, **event.model_dump(mode="json")})
    return f"{robot:<12} {event_text(event)}  p={event.probability:.2f}"


def follow(
    bus: Bus, inbox: Inbox[JunctionEvent], as_json: bool, flight: Path | None, until_s: float
) -> None:
    """Print events until the bus stops, `until_s` (monotonic), or the end of the local flight."""
    once = Once()
    while bus.running and time.monotonic() < until_s:
        bus.wait(min(WAIT_S, max(0.0, until_s - time.monotonic())))
        for robot, event in once.news(inbox.drain()):
            print(line(robot, event, as_json), flush=True)
        if flight is not None and not (flight / "flight.json").exists():
            print("the flight has ended", file=sys.stderr)
            return


def newest_flight(robot: str | None) -> Path:
    """Return the directory of the newest flight that runs on this host.

    Raises:
        FileNotFoundError: none runs; the text says what to do.
    """
    running = running_flights(None if robot == "*" else robot)
    if not running:
        whose = "" if robot in (None, "*") else f" of robot {robot}"
        raise FileNotFoundError(f"no flight{whose} runs here: start one, or name one by --connect")
    return running[-1].directory


def main(argv: list[str]) -> int:
    """Print events until interrupted; 1 when there is no flight to listen to."""
    parser = argparse.ArgumentParser(prog="juncnet events", description=__doc__)
    parser.add_argument("--json", action="store_true", help="one object a line")
    parser.add_argument(
        "--robot", help="its name, or * for all (default: the flight's robot; by a router: robot)"
    )
    parser.add_argument(
        "--connect",
        metavar="HOST:PORT|DIR",
        help="a gateway or a flight directory (default: the newest flight on this host)",
    )
    parser.add_argument("--for", type=positive, dest="limit", metavar="SECONDS", help="end after")
    options = parser.parse_args(argv)
    until_s = float("inf") if options.limit is None else time.monotonic() + options.limit
    try:
        target = options.connect or newest_flight(options.robot)
        with connect(target, None if options.robot == "*" else options.robot) as bus:
            inbox = bus.subscribe(JUNCTION_EVENT, CAPACITY, robot=options.robot)
            flight = Path(target) if Path(target).is_dir() else None
            follow(bus, inbox, options.json, flight, until_s)
    except BrokenPipeError:  # whoever read our output has gone; there is nobody to tell
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except (ConnectionError, FileNotFoundError) as error:
        print(f"juncnet events: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 0
    return 0
