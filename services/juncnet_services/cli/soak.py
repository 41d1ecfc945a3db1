"""`juncnet soak`: flies world after world until many junctions were passed, killing as it goes.

With `--kill` the six services and the guard of command_output are killed in turn (SIGKILL) at
random moments while the robot moves; the simulator is the drone, and lives. All is measured where
setpoints reach the vehicle. Exits 0 when every count was exact, every turn led into the right road
and every hold came within 0.2 s of the last velocity command; else 1.
"""

import argparse
import random
import sys
from collections.abc import Sequence
from pathlib import Path

from pydantic import BaseModel, ConfigDict

from juncnet.clocks import MAX_COMMAND_AGE_S
from juncnet.layout import LayoutError
from juncnet_services.cli.demo import START_S, Demo, prepare
from juncnet_services.cli.flights import write_report
from juncnet_services.cli.judge import Summary
from juncnet_services.cli.provenance import Provenance, provenance
from juncnet_services.cli.ranges import ending, make_room_for, positive, whole
from juncnet_services.cli.strikes import VICTIMS, Strike, Striker

PERIOD_S = 8.0
PATIENCE = 5.0
"""A flight ends unfinished after this many times its ideal time: every kill is a stop."""
FRUITLESS = 3
"""After so many flights in a row that pass no junction the soak gives up."""


class Soaked(BaseModel):
    """One flight of a soak."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    seed: int
    summary: Summary
    strikes: tuple[Strike, ...]
    resumed: int
    """How often the robot had stopped for good, and an operator's resume was sent."""

    @property
    def exact(self) -> bool:
        """Whether the count is exact and every turn led into the right road."""
        s = self.summary
        return s.junctions_counted == s.junctions_true and s.turns_taken == s.turns_planned


class Soak(BaseModel):
    """A soak: its flights, and what they were flown with."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    vehicle: str
    provenance: Provenance
    flights: tuple[Soaked, ...]

    @property
    def passes(self) -> int:
        """Junctions passed in truth."""
        return sum(f.summary.junctions_true for f in self.flights)

    @property
    def strikes(self) -> list[Strike]:
        """All kills, in order."""
        return [strike for flight in self.flights for strike in flight.strikes]

    @property
    def late(self) -> list[Strike]:
        """Kills whose hold came later than it may after the last velocity command."""
        return [s for s in self.strikes if (s.since_command_s or 0.0) > MAX_COMMAND_AGE_S]

    @property
    def right(self) -> bool:
        """Whether counts, turns and holds were all as they should be."""
        return bool(self.flights) and all(f.exact for f in self.flights) and not self.late


def fly(vehicle: str, seed: int, kill: bool, period_s: float, settings: Sequence[str]) -> Soaked:
    """Fly the world of `seed` once.

    Raises:
        LayoutError: an option is wrong.
        RuntimeError: the flight did not start, or the kills could not be made.
    """
    demo = Demo(prepare(vehicle, None, seed, None, settings))
    victims = VICTIMS if kill else ()
    # Another flight begins with another victim, so that all of them are struck in every phase.
    victims = (*victims[seed % len(VICTIMS) :], *victims[: seed % len(VICTIMS)])
    try:
        with demo, Striker(demo.flight, victims, period_s, random.Random(seed)) as striker:
            summary = demo.fly(START_S + PATIENCE * demo.setup.plan.ideal_s, None, verbose=False)
    finally:
        demo.discard()
    if striker.failure is not None:
        raise RuntimeError(f"kills: {striker.failure}") from striker.failure
    return Soaked(
        seed=seed,
        summary=summary,
        strikes=tuple(striker.strikes(seed)),
        resumed=striker.resumed,
    )


def line(flown: Soaked, passes: int) -> str:
    """Return a flight as one line, with the passes so far."""
    s = flown.summary
    verdict = "exact" if flown.exact else "NOT EXACT"
    return (
        f"seed {flown.seed:>4}  {verdict:<9}  {s.junctions_counted}/{s.junctions_true} junctions  "
        f"{s.turns_taken}/{s.turns_planned} turns  {len(flown.strikes)} kills  {s.time_s:5.1f} s  "
        f"{passes} passes so far"
    )


def _span(values: Sequence[float | None]) -> str:
    """Return the median and the largest of what is known, in seconds."""
    known = sorted(value for value in values if value is not None)
    return f"{known[len(known) // 2]:.3f} / {known[-1]:.3f}" if known else "-"


def markdown(soak: Soak) -> str:
    """Return the soak as Markdown: the result, and a row for each kind of process killed."""
    origin, strikes = soak.provenance, soak.strikes
    exact = sum(f.exact for f in soak.flights)
    heads = ("killed", "times", "held", "kill to hold s", "last command to hold s")
    heads += ("kill to slowing s", "longest silence s", "rest to motion s")
    rows = [heads, ("---",) * len(heads)]
    for process in VICTIMS:
        of = [s for s in strikes if s.process == process]
        rows.append(
            (
                process,
                str(len(of)),
                str(sum(s.hold_s is not None for s in of)),
                _span([s.hold_s for s in of]),
                _span([s.since_command_s for s in of]),
                _span([s.still_s for s in of]),
                _span([s.silence_s for s in of]),
                _span([s.commanded_s for s in of]),
            )
        )
    return "\n".join(
        [
            f"**{soak.passes} junctions passed in {len(soak.flights)} flights ({soak.vehicle}), "
            f"{len(strikes)} kills; count and turns exact in {exact} flights; "
            f"{len(soak.late)} holds late; {sum(f.resumed for f in soak.flights)} resumed.**",
            f"Measured {origin.date} on {origin.cores} cores of {origin.cpu}, "
            f"Python {origin.python}, commit {origin.commit or 'unknown'}, with",
            f"`{origin.command}`. Times: median / largest.",
            "",
            *("| " + " | ".join(row) + " |" for row in rows),
            "",
        ]
    )


def arguments(argv: list[str]) -> argparse.Namespace:
    """Return the parsed command line."""
    parser = argparse.ArgumentParser(prog="juncnet soak", description=__doc__)
    parser.add_argument(
        "--passes", type=whole(1), default=100, help="junctions to pass (default 100)"
    )
    parser.add_argument("--kill", action="store_true", help="kill processes in mid-flight")
    parser.add_argument(
        "--period", type=positive, default=PERIOD_S, metavar="SECONDS", help="of kills"
    )
    parser.add_argument("--first-seed", type=whole(0), default=1)
    parser.add_argument("--vehicle", choices=("copter", "rover"), default="copter")
    parser.add_argument("--out", type=ending(".json"), default=Path("models/soak.json"))
    parser.add_argument(
        "--set", action="append", default=[], metavar="SECTION.OPTION=VALUE", help="repeatable"
    )
    return parser.parse_args(argv)


def main(argv: list[str]) -> int:
    """Fly, and write the report after each flight."""
    options = arguments(argv)
    soak = Soak(
        vehicle=options.vehicle, provenance=provenance(["juncnet", "soak", *argv]), flights=()
    )
    seed, fruitless = options.first_seed, 0
    try:
        make_room_for(options.out)
        while soak.passes < options.passes and fruitless < FRUITLESS:
            flown = fly(options.vehicle, seed, options.kill, options.period, options.set)
            seed += 1
            fruitless = 0 if flown.summary.junctions_true else fruitless + 1
            soak = soak.model_copy(update={"flights": (*soak.flights, flown)})
            print(line(flown, soak.passes), flush=True)
            write_report(soak, markdown(soak), options.out)
    except (LayoutError, ValueError) as error:
        print(f"juncnet soak: {error}", file=sys.stderr)
        return 2
    except (RuntimeError, ConnectionError) as error:
        print(f"juncnet soak: {error}", file=sys.stderr)
        return 1
    print(f"\n{markdown(soak)}\nwritten to {options.out}")
    return 0 if soak.right and soak.passes >= options.passes else 1
