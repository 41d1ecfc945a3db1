"""`juncnet doctor [LAYOUT]`: looks at a layout before flight: what is wrong, and what helps.

Links, certificates and their dates, clocks, model, camera, vehicle, disk. Where the layout is up it
listens to its processes too. Exits 0 when it can be flown (warnings included), 1 when not.
"""

import argparse
import json
import sys
import tempfile
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

from juncnet.assets import asset_path
from juncnet.flight import Flight, read_flight
from juncnet.launch import connect
from juncnet.layout import Layout, LayoutError, load_layout
from juncnet_services.cli.doctor import links, parts, running
from juncnet_services.cli.doctor.findings import Finding, Level, failure, lines, ok, worst
from juncnet_services.cli.local_flights import running_flights


def examine(layout: Layout, flight: Flight | None, ask: bool) -> Iterator[Finding]:
    """Yield what is found; `flight`: the layout as it runs now; `ask`: the vehicle, too."""
    now = datetime.now(UTC)
    yield _layout(layout)
    yield links.wall_clock(now)
    yield from links.certificates(layout, now)
    yield links.sockets()
    yield from links.router(layout, flight is not None)
    yield from links.vehicle_link(layout)
    yield from parts.model(layout)
    yield from parts.disk(layout)
    if flight is None:
        yield from parts.camera(layout)
        with tempfile.TemporaryDirectory() as folder:
            yield from parts.vehicle(layout, ask, Path(folder))
        return
    yield from _flight(flight)


def running_now(layout: Layout) -> Flight | None:
    """Return the newest flight that runs all processes of the layout; None when none does."""
    wanted = set(layout.processes)
    flights = [f for f in running_flights(layout.launch.robot) if wanted <= set(f.processes)]
    return flights[-1] if flights else None


def _layout(layout: Layout) -> Finding:
    try:
        layout.validate_all()
    except LayoutError as error:
        return failure("layout", str(error), "correct the layout file or the --set")
    return ok("layout", f"{layout.path}: {', '.join(layout.processes)}")


def _flight(flight: Flight) -> Iterator[Finding]:
    try:
        with connect(flight.directory) as bus:
            healths, state = running.listen(bus, flight)
    except ConnectionError as error:
        yield failure("processes", str(error), "juncnet status")
        return
    yield from running.processes(flight, healths)
    yield from running.clocks(healths)
    yield from running.camera(healths)
    if "command_output" in flight.processes:
        yield from running.vehicle(state)


def main(argv: list[str]) -> int:
    """Print what is found; 0 when it can be flown with, 1 when not, 2 when there is no layout."""
    parser = argparse.ArgumentParser(prog="juncnet doctor", description=__doc__)
    parser.add_argument("layout", nargs="?", default="local", help="file or built-in (local)")
    parser.add_argument(
        "--set", action="append", default=[], metavar="SECTION.OPTION=VALUE", help="repeatable"
    )
    parser.add_argument(
        "--vehicle",
        action="store_true",
        help="connect to the vehicle too: on the ground only, it ends with a hold or a landing",
    )
    parser.add_argument(
        "--flight", type=Path, metavar="DIR", help="the layout as it runs (default: looked for)"
    )
    parser.add_argument("--json", action="store_true", help="one object")
    options = parser.parse_args(argv)
    try:
        layout = load_layout(asset_path(options.layout, "layouts", ".toml"), options.set)
        flight = running_now(layout) if options.flight is None else read_flight(options.flight)
    except (LayoutError, OSError) as error:
        print(f"juncnet doctor: {error}", file=sys.stderr)
        return 2
    findings: list[Finding] = []
    for finding in examine(layout, flight, options.vehicle):
        findings.append(finding)
        if not options.json:
            print("\n".join(lines([finding])), flush=True)
    verdict = worst(findings)
    if options.json:
        rows = [finding.model_dump(mode="json") for finding in findings]
        print(json.dumps({"verdict": verdict, "findings": rows}, indent=2))
    return 1 if verdict is Level.FAILURE else 0
