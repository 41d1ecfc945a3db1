"""`juncnet replay`: plays a recording into the pipeline, shows it to viewers, or checks it.

Without an option, the recorded camera and vehicle are played into the present services, started for
it with the recorded layout; their junction events are compared with the recorded ones. `--viewers`
publishes everything as it was and starts no services, for a dashboard or a subscriber. `--check`
calls the present code frame by frame and reports what would now be decided differently.
"""

import argparse
import json
import sys
from collections.abc import Callable
from pathlib import Path

from juncnet.recording import MISSING


def main(argv: list[str]) -> int:
    """Replay; 0 when the events are the recorded ones, 1 when not, 2 for bad arguments."""
    options = _arguments(argv)
    try:
        from juncnet.recording.reader import RecordingError, open_recording
        from juncnet_services.cli import replay_check, replay_play
    except ImportError as error:
        print(f"juncnet replay: {MISSING} ({error})", file=sys.stderr)
        return 2
    if options.speed <= 0:
        print("juncnet replay: --speed must be more than 0", file=sys.stderr)
        return 2
    wait: Callable[[], None] | None = _wait_for_enter if options.step else None
    try:
        recording = open_recording(options.recording)
        if options.check:
            report = replay_check.check(recording, options.set)
            print(json.dumps(report.fields()) if options.json else report.text())
            return 0 if report.same else 1
        if options.viewers:
            replay_play.show(recording, options.speed, wait)
            return 0
        comparison = replay_play.fly(recording, options.speed, wait, options.set)
        print(json.dumps(comparison.fields()) if options.json else comparison.text())
        return 0 if comparison.same else 1
    except (RecordingError, OSError, ValueError) as error:
        print(f"juncnet replay: {error}", file=sys.stderr)
        return 2


def _arguments(argv: list[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="juncnet replay", description=__doc__)
    parser.add_argument("recording", type=Path, help="file, or a folder: its newest recording")
    what = parser.add_mutually_exclusive_group()
    what.add_argument("--check", action="store_true", help="compare decisions, frame by frame")
    what.add_argument("--viewers", action="store_true", help="publish all that was recorded")
    parser.add_argument("--speed", type=float, default=1.0, help="times as fast (default 1)")
    parser.add_argument("--step", action="store_true", help="Enter gives the next frame")
    parser.add_argument("--json", action="store_true", help="print the result as one object")
    parser.add_argument(
        "--set", action="append", default=[], metavar="SECTION.OPTION=VALUE", help="repeatable"
    )
    return parser.parse_args(argv)


def _wait_for_enter() -> None:
    print("Enter: next frame", end="", file=sys.stderr, flush=True)
    sys.stdin.readline()
