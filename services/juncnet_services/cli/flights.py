"""`juncnet flights`: flies one world after the other, judges each flight and keeps the results.

Worlds are named by their seeds: `--seeds 1-20`, or `--commit HASH --count 20`, so that nobody can
choose worlds that suit the program: the i-th seed (from 0) is 10000 + (the first 8 bytes of
sha256("HASH:i"), big-endian, modulo 990000), repeats left out.

A void flight (the machine was too slow for the simulation, or an operator intervened and it failed)
is flown again, at most twice. With `--simulated` the cores of all services fly in one process in
simulated time, every command 0 to 120 ms late as drawn: never void, whatever else the machine does,
and without what only processes show (lost messages, a busy machine). Exits 0 when all were flown
right, 1 when not, 2 for bad arguments.
"""

import argparse
import hashlib
import json
import random
import re
import sys
from collections.abc import Sequence
from pathlib import Path

from pydantic import BaseModel, ConfigDict, ValidationError

from juncnet.layout import LayoutError
from juncnet_services.cli.demo import Demo, prepare
from juncnet_services.cli.judge import Summary
from juncnet_services.cli.provenance import Provenance, provenance
from juncnet_services.cli.ranges import ending, keep_earlier, make_room_for, whole

LOWEST_SEED, SEEDS = 10_000, 990_000
VOID_REPEATS = 2
MAX_SEEDS = 10_000
SAME = ("vehicle", "simulated", "settings")


class Flown(BaseModel):
    """A world and how it was flown."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    seed: int
    voids: int
    """Void flights before the one of the summary."""
    summary: Summary

    @property
    def again(self) -> str:
        """How often the world had to be flown again, to be said behind the verdict."""
        return f", after {self.voids} void" if self.voids else ""


class Report(BaseModel):
    """The flights of one vehicle, and what they were flown with."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    vehicle: str
    simulated: bool = False
    """Whether in simulated time."""
    settings: tuple[str, ...]
    provenance: Provenance
    flights: tuple[Flown, ...]

    @property
    def all_right(self) -> bool:
        """Whether there are flights and all of them were flown right."""
        return bool(self.flights) and all(f.summary.flown_right for f in self.flights)


def seeds_of(text: str) -> list[int]:
    """Return the seeds of a text such as `1-20` or `3,7,30-32`.

    Raises:
        ValueError: it is not such a text.
    """
    seeds: list[int] = []
    for part in text.split(","):
        match = re.fullmatch(r"\s*(\d+)(?:-(\d+))?\s*", part)
        first, last = (int(match[1]), int(match[2] or match[1])) if match else (1, 0)
        if not first <= last < first + MAX_SEEDS:
            raise ValueError(f"--seeds {text}: write them as 1-20 or 3,7,30-32")
        seeds += range(first, last + 1)
    return list(dict.fromkeys(seeds))


def seeds_of_commit(commit: str, count: int) -> list[int]:
    """Return `count` seeds that follow from a commit's hash; the formula is at the top.

    Raises:
        ValueError: `commit` is no hash in lower-case hexadecimal digits.
    """
    if not re.fullmatch(r"[0-9a-f]{7,64}", commit):
        raise ValueError(f"--commit {commit}: give its hash, lower-case hexadecimal digits")
    if not 1 <= count <= MAX_SEEDS:
        raise ValueError(f"--count {count}: 1 to {MAX_SEEDS}")
    seeds: dict[int, None] = {}
    index = 0
    while len(seeds) < count:
        digest = hashlib.sha256(f"{commit}:{index}".encode()).digest()
        seeds[LOWEST_SEED + int.from_bytes(digest[:8], "big") % SEEDS] = None
        index += 1
    return list(seeds)


def fly(vehicle: str, seed: int, settings: Sequence[str]) -> Flown:
    """Fly the world of `seed`, again when the flight is void, and return how it went.

    The logs of a failed flight are kept; standard error says where.

    Raises:
        LayoutError: an option is wrong.
    """
    voids = 0
    while True:
        demo = Demo(prepare(vehicle, None, seed, None, settings))
        failed = False
        try:
            with demo:
                summary = demo.fly(None, None, verbose=False)
            failed = summary.verdict == "failed"
        finally:
            if not failed:
                demo.discard()
        if failed:
            print(f"logs of seed {seed}: {demo.flight.directory}", file=sys.stderr, flush=True)
        if summary.verdict != "void" or voids == VOID_REPEATS:
            return Flown(seed=seed, voids=voids, summary=summary)
        voids += 1


def fly_simulated(vehicle: str, seed: int, settings: Sequence[str]) -> Flown:
    """Fly the world of `seed` in simulated time and return how it went.

    Raises:
        LayoutError: an option is wrong.
        RuntimeError: an input was refused on the way, or the follower failed.
    """
    import cv2

    from juncnet_services.cli.closed_loop import ClosedLoop

    cv2.setNumThreads(1)  # as in the services
    setup = prepare(vehicle, None, seed, None, settings)
    loop = ClosedLoop(setup, lateness=random.Random(seed))
    summary = loop.fly()
    if loop.trace.errors:
        raise RuntimeError(f"seed {seed}: {loop.trace.errors[0]}")
    return Flown(seed=seed, voids=0, summary=summary)


def line(flown: Flown) -> str:
    """Return a flight as one line."""
    s = flown.summary
    reasons = f": {'; '.join(s.reasons)}" if s.reasons else ""
    return (
        f"seed {flown.seed:>6}  {s.verdict:<11}  {s.junctions_counted}/{s.junctions_true} junctions"
        f"  {s.turns_taken}/{s.turns_planned} turns  {s.time_s:5.1f} s{flown.again}{reasons}"
    )


def markdown(report: Report) -> str:
    """Return the report as a Markdown table with its summary."""
    flights, origin = report.flights, report.provenance
    right = sum(f.summary.flown_right for f in flights)
    void = sum(f.summary.verdict == "void" for f in flights)
    heads = ["seed", "verdict", "junctions", "turns", "on road %", "off m", "rms m", "collisions"]
    heads += ["time s", "ideal s"]
    heads += [] if report.simulated else ["real time", "FPS", "p50 ms", "p99 ms"]
    heads += ["reasons"]
    rows = [heads, ["---"] * len(heads)]
    for flown in flights:
        s = flown.summary
        row = [
            str(flown.seed),
            s.verdict.replace("_", " ") + flown.again,
            f"{s.junctions_counted}/{s.junctions_true}",
            f"{s.turns_taken}/{s.turns_planned}",
            f"{100 * s.on_road:.1f}",
            f"{s.off_road_max_m:.2f}",
            f"{s.centre_rms_m:.2f}",
            str(s.collisions),
            f"{s.time_s:.1f}",
            f"{s.ideal_time_s:.1f}",
        ]
        if not report.simulated:
            figures = (s.fps, s.latency_p50_ms, s.latency_p99_ms)
            row.append(f"{s.real_time_factor:.2f}")
            row += ["" if figure is None else f"{figure:.1f}" for figure in figures]
        rows.append([*row, "; ".join(s.reasons)])
    repeated = sum(f.voids for f in flights)
    in_real_time = f"{void} void; void and flown again: {repeated}"
    how = "in simulated time" if report.simulated else in_real_time
    return "\n".join(
        [
            f"**{right} of {len(flights)} flown right** ({report.vehicle}; {how}).",
            f"Measured {origin.date} on {origin.cores} cores of {origin.cpu}, "
            f"Python {origin.python}, commit {origin.commit or 'unknown'}, with",
            f"`{origin.command}`.",
            "",
            *("| " + " | ".join(row) + " |" for row in rows),
            "",
        ]
    )


def write_report(report: BaseModel, text: str, path: Path) -> None:
    """Write a report as JSON to `path`, whole or not at all, and `text` (Markdown) beside it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    draft = path.with_suffix(".draft")
    draft.write_text(json.dumps(report.model_dump(mode="json"), indent=1) + "\n")
    draft.replace(path)
    path.with_suffix(".md").write_text(text)


def flown_before(path: Path, wanted: Report) -> tuple[Flown, ...]:
    """Return the flights that a report at `path` has, void ones left out; none without a report.

    They must be of the same vehicle, options and code, and as simulated, as those of `wanted`.

    Raises:
        ValueError: it is no report, or one of other flights than these.
    """
    if not path.exists():
        return ()
    try:
        before = Report.model_validate_json(path.read_text())
    except ValidationError as error:
        raise ValueError(f"{path} is no report of flights: remove it") from error
    if any(getattr(before, name) != getattr(wanted, name) for name in SAME):
        raise ValueError(f"{path} has flights with other options: name another file with --out")
    commits = [r.provenance.commit.removesuffix("-changed") for r in (before, wanted)]
    if len(set(commits)) > 1:
        old, new = (commit or "no checkout" for commit in commits)
        raise ValueError(
            f"{path} has flights of other code ({old}), this is {new}: "
            "name another file with --out, or fly all anew without --resume"
        )
    return tuple(flight for flight in before.flights if flight.summary.verdict != "void")


def arguments(argv: list[str]) -> argparse.Namespace:
    """Return the parsed command line."""
    parser = argparse.ArgumentParser(
        prog="juncnet flights",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    which = parser.add_mutually_exclusive_group(required=True)
    which.add_argument("--seeds", help="for instance 1-20 or 3,7,30-32")
    which.add_argument("--commit", metavar="HASH", help="seeds that follow from a commit's hash")
    parser.add_argument("--count", type=whole(1), default=20, help="with --commit (default 20)")
    parser.add_argument("--vehicle", choices=("copter", "rover"), default="copter")
    parser.add_argument("--palette", help="colours other than the worlds' own")
    parser.add_argument("--simulated", action="store_true", help="in simulated time, one process")
    parser.add_argument(
        "--out",
        type=ending(".json"),
        help="default: models/flights-VEHICLE.json, or -VEHICLE-simulated.json",
    )
    parser.add_argument(
        "--resume", action="store_true", help="skip seeds that are in the file, void ones excepted"
    )
    parser.add_argument(
        "--set", action="append", default=[], metavar="SECTION.OPTION=VALUE", help="repeatable"
    )
    return parser.parse_args(argv)


def main(argv: list[str]) -> int:
    """Fly, and write the report after each flight."""
    options = arguments(argv)
    name = f"flights-{options.vehicle}{'-simulated' if options.simulated else ''}.json"
    out: Path = options.out or Path("models") / name
    settings = [*options.set, *([f'simulator.palette="{options.palette}"'] * bool(options.palette))]
    try:
        seeds = (
            seeds_of(options.seeds)
            if options.seeds
            else seeds_of_commit(options.commit, options.count)
        )
        report = Report(
            vehicle=options.vehicle,
            simulated=options.simulated,
            settings=tuple(settings),
            provenance=provenance(["juncnet", "flights", *argv]),
            flights=(),
        )
        if options.resume:
            report = report.model_copy(update={"flights": flown_before(out, report)})
        make_room_for(out)
        if not options.resume:
            keep_earlier(out)
        done = {flight.seed for flight in report.flights}
        fly_one = fly_simulated if options.simulated else fly
        for seed in seeds:
            if seed in done:
                continue
            flight = fly_one(options.vehicle, seed, settings)
            print(line(flight), flush=True)
            report = report.model_copy(update={"flights": (*report.flights, flight)})
            write_report(report, markdown(report), out)
    except (LayoutError, ValueError) as error:
        print(f"juncnet flights: {error}", file=sys.stderr)
        return 2
    except (RuntimeError, ConnectionError) as error:
        print(f"juncnet flights: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        raise KeyboardInterrupt("go on with --resume") from None
    write_report(report, markdown(report), out)
    print(f"\n{markdown(report)}\nwritten to {out}")
    return 0 if report.all_right else 1
