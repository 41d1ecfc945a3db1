"""`juncnet check-follower package.module:Class`: flies a follower through worlds, and scores it.

In simulated time, so that every run gives the same result, beside the built-in follower and by the
rules of `juncnet demo`. Latency is that of `follow` in this process, in real time.
"""

import argparse
import json
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np

from juncnet.frames import Frame
from juncnet.layout import LayoutError
from juncnet.messages import RoadCommand, VehicleState
from juncnet_services.cli.closed_loop import SMALL, ClosedLoop
from juncnet_services.cli.demo import LAYOUTS, prepare
from juncnet_services.cli.flights import seeds_of
from juncnet_services.road_following.follower import FollowerError
from juncnet_services.road_following.service import Config as FollowingConfig

BUILT_IN: str = FollowingConfig().follower
LEAST_ON_ROAD = 0.99


@dataclass(frozen=True)
class Score:
    """How a follower did in one world."""

    follower: str
    seed: int
    flown_right: bool
    on_road: float
    centre_rms_m: float
    off_road_max_m: float
    latency_p50_ms: float
    latency_p99_ms: float
    failures: int
    """Pictures for which it raised or returned nonsense."""
    reasons: tuple[str, ...]


class _Timed:
    """Times the calls of a runner's `command`."""

    def __init__(self, loop: ClosedLoop) -> None:
        self.times_ms: list[float] = []
        self._command = loop.runner.command
        setattr(loop.runner, "command", self)  # noqa: B010

    def __call__(self, frame: Frame, state: VehicleState | None) -> RoadCommand:
        began = time.perf_counter()
        try:
            return self._command(frame, state)
        finally:
            self.times_ms.append((time.perf_counter() - began) * 1e3)


def fly(follower: str, seed: int, vehicle: str, settings: Sequence[str]) -> Score:
    """Return the score of one flight.

    Raises:
        FollowerError: the follower cannot be loaded.
    """
    settings = (*SMALL, f"road_following.follower={follower}", *settings)
    loop = ClosedLoop(prepare(vehicle, None, seed, None, settings))
    timed = _Timed(loop)
    summary = loop.fly()
    p50, p99 = np.percentile(timed.times_ms, (50, 99))
    return Score(
        follower=follower,
        seed=seed,
        flown_right=summary.flown_right,
        on_road=summary.on_road,
        centre_rms_m=summary.centre_rms_m,
        off_road_max_m=summary.off_road_max_m,
        latency_p50_ms=float(p50),
        latency_p99_ms=float(p99),
        failures=sum("follower" in error for error in loop.trace.errors),
        reasons=summary.reasons,
    )


def row(score: Score) -> str:
    """Return a score as a line of the table."""
    return (
        f"{score.seed:>6}  {'right' if score.flown_right else 'no':<5}  "
        f"{100 * score.on_road:6.1f} %  {score.centre_rms_m:5.2f} m  "
        f"{score.off_road_max_m:5.2f} m  {score.latency_p50_ms:5.1f} / "
        f"{score.latency_p99_ms:5.1f} ms  {score.failures:>4}  "
        f"{score.follower}  {'; '.join(score.reasons)}"
    )


def main(argv: list[str]) -> int:
    """Fly and print; 0 when it stayed on the road everywhere, 1 when not, 2 for bad arguments."""
    parser = argparse.ArgumentParser(prog="juncnet check-follower", description=__doc__)
    parser.add_argument("follower", help="package.module:Class")
    parser.add_argument("--seeds", default="1-3", help="worlds, for instance 1-5 or 3,7")
    parser.add_argument("--vehicle", choices=tuple(LAYOUTS), default="copter")
    parser.add_argument("--alone", action="store_true", help="without the built-in one beside it")
    parser.add_argument("--json", action="store_true", help="print a list of scores")
    parser.add_argument(
        "--set", action="append", default=[], metavar="SECTION.OPTION=VALUE", help="repeatable"
    )
    options = parser.parse_args(argv)
    followers = [options.follower] if options.alone else [options.follower, BUILT_IN]
    scores: list[Score] = []
    try:
        if not options.json:
            print("  seed  flown   on road      rms      off   latency p50/p99  fails")
        for seed in seeds_of(options.seeds):
            for follower in followers:
                scores.append(fly(follower, seed, options.vehicle, options.set))
                if not options.json:
                    print(row(scores[-1]), flush=True)
    except (FollowerError, LayoutError, ValueError) as error:
        print(f"juncnet check-follower: {error}", file=sys.stderr)
        return 2
    if options.json:
        print(json.dumps([asdict(score) for score in scores]))
    own = [score for score in scores if score.follower == options.follower]
    return 0 if all(score.on_road >= LEAST_ON_ROAD for score in own) else 1
