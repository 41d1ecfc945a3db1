"""Flights in simulated time, for tests and tuning.

python tests/closed_loop.py --seeds 1-5 --vehicle copter
"""

import argparse
import time
from collections.abc import Sequence

import cv2
import numpy as np

from juncnet_services.cli.closed_loop import ClosedLoop, Trace
from juncnet_services.cli.demo import prepare

__all__ = ["ClosedLoop", "Trace"]


def seeds_in(text: str) -> Sequence[int]:
    """Return the seeds of `3`, `1-20` or `1,5,9`."""
    if "-" in text:
        first, last = text.split("-")
        return range(int(first), int(last) + 1)
    return [int(part) for part in text.split(",")]


def main() -> None:
    """Fly seeds and print a line each."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", default="1")
    parser.add_argument("--vehicle", default="copter")
    parser.add_argument("--set", action="append", default=[])
    parser.add_argument("--verbose", action="store_true")
    parser.add_argument("--oracle", action="store_true", help="scores from the truth")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    right = 0
    for seed in seeds_in(options.seeds):
        started = time.monotonic()
        setup = prepare(options.vehicle, None, seed, None, options.set)
        loop = ClosedLoop(setup, oracle=options.oracle)
        s = loop.fly()
        right += s.flown_right
        errors = loop.trace.errors
        print(
            f"seed {seed}: {s.verdict}, {s.junctions_counted}/{s.junctions_true} junctions, "
            f"{s.turns_taken}/{s.turns_planned} turns, {s.off_road_max_m:.2f} m off, "
            f"rms {s.centre_rms_m:.2f} m, {s.time_s:.0f}/{s.ideal_time_s:.0f} s, "
            f"{'; '.join(s.reasons)} [{time.monotonic() - started:.0f} s]"
            + (f" errors: {len(errors)} {errors[0]}" if errors else ""),
            flush=True,
        )
        if options.verbose:
            for event in loop.trace.events:
                at = int(
                    np.argmin([abs(t.at.time_ns - event.header.time_ns) for t in loop.trace.truth])
                )
                t = loop.trace.truth[at]
                print(
                    "   ",
                    event.kind.value,
                    event.count,
                    f"t={at / 25:.1f}",
                    f"mouth={t.mouth_m}",
                    f"j={t.junction_id}",
                    f"({t.pose.x_m:.1f},{t.pose.y_m:.1f})",
                )
    print(f"{right} flown right")


if __name__ == "__main__":
    main()
