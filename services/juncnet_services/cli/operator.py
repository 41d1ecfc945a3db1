"""`juncnet stop | land | resume | emergency`: an operator's order and its confirmation."""

import argparse
import getpass
import re
import sys
from pathlib import Path

from juncnet.bus import Bus
from juncnet.clocks import NS_PER_S
from juncnet.flight import flights_root
from juncnet.launch import connect
from juncnet.messages import Ack, Override, OverrideKind, Stamp
from juncnet.topics import COMMAND_ACK, COMMAND_OVERRIDE

KINDS = {
    "stop": OverrideKind.HOLD,
    "land": OverrideKind.LAND,
    "resume": OverrideKind.RESUME,
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

    Returns:
        The answer, None when there was none within `timeout_s`, and the seconds that it took.
    """
    answers = bus.subscribe(COMMAND_ACK, capacity=64)
    started_ns = bus.clock.now_ns()
    ours: list[Stamp] = []
    while True:
        if _seconds_since(bus, started_ns) >= len(ours) * REPEAT_S:
            ours.append(bus.stamp())
            override = Override(issued=ours[-1], kind=kind, operator=operator)
            bus.publish(COMMAND_OVERRIDE, override)
        bus.wait(REPEAT_S)
        took_s = _seconds_since(bus, started_ns)
        for _, ack in answers.drain():
            if ack.override in ours:
                return ack, took_s
        if took_s >= timeout_s or not bus.running:
            return None, took_s


def confirmed() -> bool:
    """Return whether the operator has confirmed an emergency, twice."""
    words = ("EMERGENCY", "CUT")
    return all(
        input(question).strip() == word for question, word in zip(CONFIRMATIONS, words, strict=True)
    )


def newest_flight() -> Path:
    """Return the directory of this user's newest flight.

    Raises:
        FileNotFoundError: there is none.
    """
    found = sorted(flights_root().glob("*/flight.json"), key=lambda path: path.stat().st_mtime)
    if not found:
        raise FileNotFoundError(f"no flight in {flights_root()}: name one with --flight")
    return found[-1].parent


def main(argv: list[str]) -> int:
    """Run `argv`, the order and its options; return 0 when it was obeyed, else 1."""
    parser = argparse.ArgumentParser(prog="juncnet", description=__doc__)
    parser.add_argument("order", choices=KINDS)
    parser.add_argument("--flight", help="flight directory or gateway host:port (default: newest)")
    parser.add_argument("--robot", default="robot", help="its name, through a gateway")
    parser.add_argument("--operator", default=_name(), help="who orders")
    parser.add_argument("--timeout", type=float, default=3.0, metavar="SECONDS")
    options = parser.parse_args(argv)
    if options.order == "emergency" and not confirmed():
        print("nothing done", file=sys.stderr)
        return 1
    try:
        target = options.flight or newest_flight()
        with connect(target, options.robot) as bus:
            ack, took_s = order(bus, KINDS[options.order], options.operator, options.timeout)
    except (ConnectionError, FileNotFoundError) as error:
        print(f"juncnet {options.order}: {error}", file=sys.stderr)
        return 1
    if ack is None:
        print(f"{options.order}: NO ANSWER within {took_s:.1f} s", file=sys.stderr)
        return 1
    verdict = "obeyed" if ack.accepted else "REFUSED"
    print(f"{options.order}: {verdict} after {1000 * took_s:.0f} ms: {ack.reason}")
    return 0 if ack.accepted else 1


def _seconds_since(bus: Bus, then_ns: int) -> float:
    return (bus.clock.now_ns() - then_ns) / NS_PER_S


def _name() -> str:
    """Return the user's name as an operator's; `operator` where it has none that fits."""
    try:
        name = getpass.getuser()
    except (KeyError, OSError):
        return "operator"
    return name if re.fullmatch(r"[A-Za-z0-9_.:+-]{1,64}", name) else "operator"
