"""`juncnet bench split`: a simulated mission flown from another host, over a link like WiFi.

Needs root, for it makes two hosts with clocks of their own and an access point between them
(`bench/two_hosts.py`). Of its flights `undisturbed` is left alone; in `disturbed`, video of another
robot overloads the link, and then nothing passes for a while; in `delayed` every packet is late.
"""

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np

from juncnet.clocks import MAX_COMMAND_AGE_S, NS_PER_S
from juncnet_services.cli.bench.split_flight import Heard, SplitFlight, log_tails
from juncnet_services.cli.bench.two_hosts import CLOCK_AHEAD_S, TwoHosts, why_not
from juncnet_services.cli.demo import PATIENCE, prepare
from juncnet_services.cli.link_tap import Told
from juncnet_services.cli.provenance import provenance

OVERLOAD = 1.5
"""Video that is sent too much, as a multiple of the link's rate."""
SETTLE_S = 10.0
"""Of calm flight, after which the overload begins."""
FLIGHTS = ("undisturbed", "disturbed", "delayed")
Figures = dict[str, Any]


def spread_ms(values: Sequence[float]) -> Figures:
    """Return count, median, 99th percentile and largest of these ms; nothing of no values."""
    if not values:
        return {"count": 0}
    p50, p99 = np.percentile(values, [50, 99])
    return {
        "count": len(values),
        "p50_ms": round(float(p50), 1),
        "p99_ms": round(float(p99), 1),
        "max_ms": round(max(values), 1),
    }


def ages(heard: Sequence[Heard]) -> Figures:
    """Return the ages of commands and of their pictures on arrival at the vehicle's host."""
    return {
        "command_age": spread_ms([command.age_ms for command in heard]),
        "picture_age": spread_ms([command.picture_age_ms for command in heard]),
    }


def obeyed_ages_ms(told: Sequence[Told], heard: Sequence[Heard]) -> list[float]:
    """Return, for each setpoint that moved the vehicle, how old the newest command was by then.

    A command counts from 5 ms before it was heard: command_output may have heard it sooner.
    """
    found: list[float] = []
    newest_ns, commands = None, iter(sorted(heard, key=lambda c: c.arrived_ns))
    following = next(commands, None)
    for setpoint in told:
        while following is not None and following.arrived_ns <= setpoint.ns + 5_000_000:
            newest_ns = max(newest_ns or 0, following.issued_ns)
            following = next(commands, None)
        if not setpoint.holds and newest_ns is not None:
            found.append((setpoint.ns - newest_ns) / 1e6)
    return found


def outage_figures(flight: SplitFlight, hosts: TwoHosts, seconds: float) -> Figures:
    """Let nothing pass for so long while the robot moves, and return what the vehicle was told."""
    if not flight.until_moving():
        return {"error": "the robot did not move"}
    began_ns = flight.ears.bus.clock.now_ns()
    with hosts.outage():
        flight.listen(seconds)
    ended_ns = flight.ears.bus.clock.now_ns()
    flight.listen(8.0)
    told, heard = list(flight.tap.told), flight.ears.commands
    hold = next((t for t in told if t.holds and t.ns > began_ns), None)
    again = next((t for t in told if not t.holds and t.ns > ended_ns), None)
    last = max((c.issued_ns for c in heard if hold and c.arrived_ns < hold.ns), default=None)
    arrived = max((c.arrived_ns for c in heard if hold and c.arrived_ns < hold.ns), default=None)
    late = [c.age_ms for c in heard if c.arrived_ns > began_ns + NS_PER_S]
    return {
        "seconds": seconds,
        "hold_after_last_issue_s": hold and last and round((hold.ns - last) / NS_PER_S, 3),
        "hold_after_last_arrival_s": hold and arrived and round((hold.ns - arrived) / NS_PER_S, 3),
        "moves_again_after_s": again and round((again.ns - ended_ns) / NS_PER_S, 3),
        "commands_too_old_on_arrival": sum(age > 1e3 * MAX_COMMAND_AGE_S for age in late),
    }


def clock_figures(flight: SplitFlight) -> Figures:
    """Return how well command_output knows the laptop's clock, whose offset is known exactly."""
    known = [
        clock
        for health in flight.ears.health.values()
        if health.service == "command_output"
        for clock in health.clocks.values()
        if clock.offset_ns is not None and clock.uncertainty_ns is not None
    ]
    if not known:
        return {"error": "not measured"}
    error_ns = (known[-1].offset_ns or 0) - CLOCK_AHEAD_S * NS_PER_S
    uncertainty_ms = round((known[-1].uncertainty_ns or 0) / 1e6, 3)
    return {"error_ms": round(error_ns / 1e6, 3), "uncertainty_ms": uncertainty_ms}


def fly(hosts: TwoHosts, folder: Path, options: argparse.Namespace, kind: str) -> Figures:
    """Fly the mission once, as `kind` of `FLIGHTS` says, and return the figures."""
    width, height = (int(n) for n in options.size.split("x"))
    setup = prepare("copter", None, options.seed)
    with SplitFlight(hosts, folder, setup, (width, height), round(options.video * 1e6)) as flight:
        figures: Figures = {"moved": flight.until_moving()}
        cpu, began_s = flight.drone_cpu_s(), time.monotonic()
        calm = len(flight.ears.commands)
        flight.listen(SETTLE_S)
        elapsed_s = time.monotonic() - began_s
        used = {name: s - cpu.get(name, 0.0) for name, s in flight.drone_cpu_s().items()}
        figures["drone_cpu_percent"] = {n: round(100 * s / elapsed_s, 1) for n, s in used.items()}
        figures["drone_cpu_percent"]["sum"] = round(100 * sum(used.values()) / elapsed_s, 1)
        if kind == "disturbed":
            first = len(flight.ears.commands)
            with flight.overload(round(OVERLOAD * options.rate * 1e6)):
                flight.listen(options.overload)
            figures["overload"] = ages(flight.ears.commands[first:])
            figures["outage"] = outage_figures(flight, hosts, options.outage)
        flight.listen_to_the_end(PATIENCE * setup.plan.ideal_s + options.outage)
        commands = flight.ears.commands
        if kind != "disturbed":
            figures["calm"] = ages(commands[calm:])
        figures["obeyed_command_age"] = spread_ms(obeyed_ages_ms(flight.tap.told, commands))
        figures["clock"] = clock_figures(flight)
        figures["flight"] = flight.ears.judge.summary().model_dump(mode="json")
    return figures


def arguments(argv: list[str]) -> argparse.Namespace:
    """Return the parsed command line."""
    parser = argparse.ArgumentParser(prog="juncnet bench split", description=__doc__)
    parser.add_argument("--rate", type=float, default=40.0, help="of the link [Mbit/s]")
    parser.add_argument("--size", default="856x480", help="of the pictures; a Bebop 2's")
    parser.add_argument("--video", type=float, default=8.0, help="of the camera [Mbit/s]")
    parser.add_argument("--seed", type=int, default=24, help="of the world")
    parser.add_argument("--overload", type=float, default=25.0, help="for so long [s]")
    parser.add_argument("--outage", type=float, default=3.0, help="for so long [s]")
    parser.add_argument("--delay", type=float, default=0.1, help="there and back together [s]")
    parser.add_argument("--flights", nargs="+", choices=FLIGHTS, default=FLIGHTS, help="which")
    parser.add_argument("--json", action="store_true", help="print the figures as JSON")
    parser.add_argument("--out", type=Path, help="write them into this file as well")
    return parser.parse_args(argv)


def main(argv: list[str]) -> int:
    """Fly, and print what was measured."""
    options = arguments(argv)
    reason = why_not()
    if reason is not None:
        print(f"juncnet bench split: no hosts can be made here: {reason}", file=sys.stderr)
        return 2
    origin = provenance(["juncnet", "bench", "split", *argv])
    result: Figures = {"provenance": origin.model_dump(mode="json")}
    for name in options.flights:
        with ExitStack() as stack:
            folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="jn-")))
            hosts = stack.enter_context(TwoHosts())
            hosts.shape(round(options.rate * 1e6))
            if name == "delayed":
                stack.enter_context(hosts.delay(options.delay / 2))
            try:
                result[name] = fly(hosts, folder, options, name)
            except (RuntimeError, ConnectionError) as error:
                print(f"juncnet bench split: {error}\n{log_tails(folder)}", file=sys.stderr)
                return 1
        if not options.json:
            print(f"{name}\n{json.dumps(result[name], indent=2)}", flush=True)
    text = json.dumps(result, indent=2)
    if options.json:
        print(text)
    if options.out is not None:
        options.out.write_text(text + "\n")
    return 0
