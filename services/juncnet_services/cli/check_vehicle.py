"""`juncnet check-vehicle package.module:Class`: puts a vehicle's driver through its contract.

In a real command_output with its guard, commanded by this process; some 10 s, and 5 s more with
`--peer`. Without `--peer` the driver's own vehicle or simulator may listen: it is told to move,
to take off, to land and to cut its motors. Props off.
"""

import argparse
import json
import sys
import tempfile
from contextlib import ExitStack
from dataclasses import asdict
from pathlib import Path
from typing import Any

from juncnet_services.command_output.limits import Limits
from juncnet_services.command_output.vehicles import check_options
from juncnet_services.kits.vehicle_contract import Judgement, judge
from juncnet_services.kits.vehicle_trial import Peer, fly

WORDS = {True: "ok", False: "FAIL", None: "-"}


def main(argv: list[str]) -> int:
    """Fly and print; 0 when nothing failed, 1 when something did, 2 for bad arguments."""
    parser = argparse.ArgumentParser(
        prog="juncnet check-vehicle",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("vehicle", help="package.module:Class, or the name of a shipped driver")
    parser.add_argument(
        "--set", action="append", default=[], metavar="OPTION=VALUE", help="of the driver"
    )
    parser.add_argument(
        "--peer",
        metavar="OPTION",
        help="the driver's option for its vehicle's UDP address: the check listens there",
    )
    parser.add_argument("--json", action="store_true", help="print a list of judgements")
    options = parser.parse_args(argv)
    try:
        found = check(options.vehicle, dict(map(_setting, options.set)), options.peer)
    except (ValueError, RuntimeError, OSError) as error:
        print(f"juncnet check-vehicle: {error}", file=sys.stderr)
        return 2
    if options.json:
        print(json.dumps([asdict(judgement) for judgement in found]))
    else:
        print("\n".join(f"{WORDS[j.passed]:<5} {j.about:<20} {j.text}" for j in found))
    return 1 if any(judgement.passed is False for judgement in found) else 0


def check(vehicle: str, settings: dict[str, Any], peer_option: str | None) -> list[Judgement]:
    """Return what is found of a driver.

    Raises:
        ValueError: there is no such driver, or it does not take these options.
        RuntimeError: command_output does not start with it.
    """
    with tempfile.TemporaryDirectory(prefix="jn-") as folder, ExitStack() as stack:
        peer = None if peer_option is None else stack.enter_context(Peer())
        if peer_option is not None and peer is not None:
            settings = settings | {peer_option: peer.address}
        check_options(vehicle, settings)
        return judge(fly(vehicle, settings, peer, Path(folder)), Limits())


def _setting(text: str) -> tuple[str, Any]:
    """Return the name and the value of `name=value`; what is no JSON is a string."""
    name, equals, value = text.partition("=")
    if not equals:
        raise ValueError(f"--set {text}: OPTION=VALUE is needed")
    try:
        return name, json.loads(value)
    except ValueError:
        return name, value
