"""`juncnet stop | land | resume | takeoff | emergency`: an operator's order and its confirmation.

Each works from any host with the right: `--flight HOST:PORT` with `--certificates`, or on the
vehicle's host itself, where it goes to the flight that runs, of `--robot` if one is named. Where
several run `stop` stops them all, and the others refuse. The vehicle's side confirms, and the time
that it took is shown.
"""

import argparse
import getpass
import re
import socket
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path

from juncnet.bus import Bus, Inbox
from juncnet.clocks import NS_PER_S
from juncnet.flight import Flight, flights_root
from juncnet.identity import CERTIFICATES_VARIABLE
from juncnet.launch import DEFAULT_ROBOT, connect
from juncnet.messages import Ack, Override, OverrideKind, Stamp
from juncnet.topics import COMMAND_ACK, COMMAND_OVERRIDE
from juncnet_services.cli.local_flights import flights_to_order
from juncnet_services.cli.ranges import positive
from juncnet_services.command_output.arbiter import AGE_UNKNOWN

KINDS = {
    "stop": OverrideKind.HOLD,
    "land": OverrideKind.LAND,
    "resume": OverrideKind.RESUME,
    "takeoff": OverrideKind.TAKE_OFF,
    "emergency": OverrideKind.EMERGENCY,
}
REPEAT_S = 0.1
CONFIRMATIONS = (
    "This cuts the motors: what flies falls. To stop the robot use `juncnet stop`.\n"
    "Type EMERGENCY to go on: ",
    "Cut the motors now? Type CUT: ",
)


def order(
    bus: Bus, kind: OverrideKind, operator: str, timeout_s: float
) -> tuple[Ack | None, float]:
    """Send an order every `REPEAT_S` until the vehicle's side answers.

    Goes on where it is refused only because our clock is not known there yet: it is being measured.

    Returns:
        The answer, None when there was none within `timeout_s`, and the seconds that it took.
    """
    answers = bus.subscribe(COMMAND_ACK, capacity=64)
    try:
        return _ordered(bus, answers, kind, operator, timeout_s)
    finally:
        bus.unsubscribe(answers)


def _ordered(
    bus: Bus, answers: Inbox[Ack], kind: OverrideKind, operator: str, timeout_s: float
) -> tuple[Ack | None, float]:
    started_ns = bus.clock.now_ns()
    ours: list[Stamp] = []
    answer: Ack | None = None
    while True:
        if _seconds_since(bus, started_ns) >= len(ours) * REPEAT_S:
            ours.append(bus.stamp())
            override = Override(issued=ours[-1], kind=kind, operator=operator, first_issued=ours[0])
            bus.publish(COMMAND_OVERRIDE, override)
        bus.wait(REPEAT_S)
        took_s = _seconds_since(bus, started_ns)
        for _, ack in answers.drain():
            if ack.override in ours:
                answer = ack
                if ack.accepted or AGE_UNKNOWN not in ack.reason:
                    return ack, took_s
        if took_s >= timeout_s or not bus.running:
            return answer, took_s


def confirmed() -> bool:
    """Return whether the operator has confirmed an emergency, twice."""
    asked = zip(CONFIRMATIONS, ("EMERGENCY", "CUT"), strict=True)
    try:
        return all(input(question).strip() == word for question, word in asked)
    except EOFError:  # nobody is there to answer
        return False


class WhichFlightError(Exception):
    """It is not clear to which flight an order shall go; the text has cause and remedy."""


def running_targets(robot: str | None) -> list[Flight]:
    """Return the flights on this host that an order can mean, at least one.

    Raises:
        WhichFlightError: there is none.
    """
    found = flights_to_order(robot)
    if found:
        return found
    whose = f" of robot {robot}" if robot else ""
    text = f"no flight{whose} runs in {flights_root()}: name one with --flight DIRECTORY|HOST:PORT"
    others = flights_to_order() if robot else []
    raise WhichFlightError("\n".join([text, *(["these run:"] if others else []), *_lines(others)]))


def only_target(flight: str | None, robot: str | None) -> str | Path:
    """Return the flight that is named, else the only one that an order can mean.

    Raises:
        WhichFlightError: there is none, or there are several.
    """
    if flight is not None:
        return flight
    found = running_targets(robot)
    if len(found) > 1:
        text = f"{len(found)} flights run here: name one with --robot or --flight"
        raise WhichFlightError("\n".join([text, *_lines(found)]))
    return found[0].directory


def _lines(flights: Sequence[Flight]) -> list[str]:
    return [f"    --robot {flight.robot}    --flight {flight.directory}" for flight in flights]


def add_link_options(parser: argparse.ArgumentParser) -> None:
    """Add the options that say which vehicle, and as whom."""
    parser.add_argument("--flight", help="directory or router host:port (default: what runs here)")
    parser.add_argument(
        "--robot", help=f"its name (default: whose flight runs; by a router: {DEFAULT_ROBOT})"
    )
    parser.add_argument("--operator", default=operator_name(), help="who orders (user.host)")
    parser.add_argument(
        "--certificates",
        type=Path,
        metavar="FOLDER",
        help=f"of the role operator, for a router (default: ${CERTIFICATES_VARIABLE})",
    )


def main(argv: list[str]) -> int:
    """Run `argv`, the order and its options; return 0 when it was obeyed, else 1."""
    parser = argparse.ArgumentParser(prog=f"juncnet {argv[0]}", description=__doc__)
    add_link_options(parser)
    parser.add_argument(
        "--timeout", type=positive, default=3.0, metavar="SECONDS", help="for the answer (3)"
    )
    options = parser.parse_args(argv[1:], argparse.Namespace(order=argv[0]))
    try:
        if options.order == "stop" and options.flight is None:
            return stop_all(running_targets(options.robot), options)
        target = only_target(options.flight, options.robot)
    except WhichFlightError as error:
        print(f"juncnet {options.order}: {error}", file=sys.stderr)
        return 1
    if options.order == "emergency" and not confirmed():
        print("nothing done", file=sys.stderr)
        return 1
    ack, text = give(target, options)
    print(text, file=sys.stdout if ack else sys.stderr)
    return 0 if ack is not None and ack.accepted else 1


def give(target: str | Path, options: argparse.Namespace) -> tuple[Ack | None, str]:
    """Give the order to a flight; return the answer, if any, and in one line what became of it."""
    try:
        with connect(target, options.robot, certificates=options.certificates) as bus:
            ack, took_s = order(bus, KINDS[options.order], options.operator, options.timeout)
    except OSError as error:  # nobody there, no such flight, or one of another user
        return None, f"juncnet {options.order}: {error}"
    return ack, verdict(options.order, ack, took_s)


def stop_all(flights: Sequence[Flight], options: argparse.Namespace) -> int:
    """Stop all flights at once, for to stop one too many is safe; return 0 when all obeyed."""
    if len(flights) > 1:
        print(f"{len(flights)} flights run here: all are stopped", file=sys.stderr)
    all_obeyed = True
    for flight, (ack, text) in _given(flights, options):
        where = f"{flight.robot} in {flight.directory}: " if len(flights) > 1 else ""
        print(f"{where}{text}", file=sys.stdout if ack else sys.stderr, flush=True)
        all_obeyed = all_obeyed and ack is not None and ack.accepted
    return 0 if all_obeyed else 1


def _given(
    flights: Sequence[Flight], options: argparse.Namespace
) -> Iterator[tuple[Flight, tuple[Ack | None, str]]]:
    """Give the order to all flights, none waiting for another; yield what became, as it comes."""
    with ThreadPoolExecutor(len(flights)) as pool:
        given = {pool.submit(give, flight.directory, options): flight for flight in flights}
        for done in as_completed(given):
            yield given[done], done.result()


def verdict(name: str, ack: Ack | None, took_s: float) -> str:
    """Return in one line what became of an order."""
    if ack is None:
        return (
            f"{name}: NO ANSWER within {took_s:.1f} s: is command_output running, is --robot"
            " its robot, and may this certificate give orders?"
        )
    became = "obeyed" if ack.accepted else "REFUSED"
    return f"{name}: {became} after {1000 * took_s:.0f} ms: {ack.reason}"


def operator_name() -> str:
    """Return user and host as an operator's name: each host counts its orders for itself."""
    try:
        user = getpass.getuser()
    except (KeyError, OSError):
        user = "operator"
    return re.sub(r"[^A-Za-z0-9_.:+-]", "-", f"{user}.{socket.gethostname()}")[:128]


def _seconds_since(bus: Bus, then_ns: int) -> float:
    return (bus.clock.now_ns() - then_ns) / NS_PER_S
