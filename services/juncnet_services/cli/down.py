"""`juncnet down`: stops what `juncnet up` started and removes its flight directory.

Nothing up is no error. A flight that another command watches over, as `juncnet demo` does, ends
with that command; `--all` ends it too.
"""

import argparse

from juncnet_services.cli.local_flights import (
    all_flights,
    end,
    is_running,
    running_flights,
    started_by_up,
)


def main(argv: list[str]) -> int:
    """Stop the flights of a robot; 0 when none of them runs any more, else 1."""
    parser = argparse.ArgumentParser(prog="juncnet down", description=__doc__)
    parser.add_argument("--robot", help="of this robot only (default: of every robot)")
    parser.add_argument("--keep", action="store_true", help="keep the flight directory: its logs")
    parser.add_argument("--all", action="store_true", help="also flights of `juncnet demo`")
    options = parser.parse_args(argv)
    flights = [f for f in all_flights(options.robot) if started_by_up(f)]
    if options.all:
        flights += [f for f in running_flights(options.robot) if not started_by_up(f)]
    for flight in flights:
        end(flight, options.keep)
        kept = ", its directory is kept" if options.keep else ""
        print(f"stopped robot {flight.robot}: {flight.directory}{kept}")
    if not flights:
        print("nothing is up")
    return 1 if any(is_running(flight) for flight in flights) else 0
