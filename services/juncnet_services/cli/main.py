"""`juncnet COMMAND ...`: dispatches to one module a command, imported only when it is called."""

import errno
import importlib
import os
import signal
import sys
from types import FrameType

COMMANDS = {
    "demo": ("demo", "fly a mission on the simulated drone and show it"),
    "up": ("up", "start a layout in the background"),
    "down": ("down", "stop a layout"),
    "status": ("status", "show rate, age and restarts of each process"),
    "dashboard": ("dashboard", "serve a page that shows robots and commands them"),
    "events": ("events", "print junction events as they happen"),
    "stop": ("operator", "hold the robot until resume"),
    "land": ("operator", "land the robot"),
    "resume": ("operator", "let the pipeline move the robot again"),
    "takeoff": ("operator", "take off, and stay stopped in the air until resume"),
    "manual": ("manual", "fly by keyboard"),
    "emergency": ("operator", "cut the motors (asks twice)"),
    "service": ("systemd", "install a layout as systemd units, or remove them"),
    "begin": ("begin", "make the directory of a new flight, for systemd's units"),
    "doctor": ("doctor.examine", "look at a layout before flight: what is wrong, and what helps"),
    "certificates": ("certificates", "make a CA and one certificate a role, for links to others"),
    "train": ("train", "train a model on labelled pictures, from nothing or from a model"),
    "curve": ("curve", "draw the AUC on watched pictures over all pictures seen in training"),
    "dataset": ("dataset", "pictures to learn from: extract, label, check, synthesise, film"),
    "record": ("record", "record every topic of a robot to MCAP files"),
    "replay": ("replay", "play a recording into the pipeline, or check what would change"),
    "report": ("report", "write the report of a recorded flight as one HTML file"),
    "new-follower": ("kits", "write a package with a road follower of your own"),
    "check-follower": ("check_follower", "fly a road follower through worlds and score it"),
    "new-vehicle": ("kits", "write a package with a vehicle's driver of your own"),
    "check-vehicle": ("check_vehicle", "put a vehicle's driver through its contract"),
    "evaluate": ("evaluate", "judge a model on labelled pictures"),
    "compare": ("compare", "train kNN, SVM, AlexNet, VGG and JuncNet on the same pictures"),
    "ablate": ("ablate", "train with one step of the preprocessing changed at a time"),
    "benchmark": ("benchmark", "train the paper's network on MNIST or CIFAR-10"),
    "follower": ("evaluate_follower", "judge a road follower on a marked video"),
    "flights": ("flights", "fly many worlds, judge each and print the table"),
    "soak": ("soak", "fly until many junctions are passed, killing processes on the way"),
    "bench": ("bench", "measure: radon, hop, pipeline, split ..."),
}


def _usage() -> str:
    width = max(map(len, COMMANDS))
    rows = [f"  {name:<{width}}  {text}" for name, (_, text) in COMMANDS.items()]
    return "\n".join(["usage: juncnet COMMAND [--help] ...", "", *rows])


_received: list[int] = []
"""Signals that ended the command. What they raise may not arrive: a library that is being imported
makes another error of it."""


def _end(number: int, _frame: FrameType | None) -> None:
    _received.append(number)
    raise SystemExit(128 + number)


REMEDIES = {
    errno.EACCES: "you may not: name another place, or ask its owner",
    errno.EROFS: "nothing can be written there: name another place",
    errno.ENOENT: "is the path right?",
    errno.ENOTDIR: "is the path right?",
    errno.EISDIR: "name a file",
    errno.ENOSPC: "make room, or name another place",
}
"""What helps when a file or folder could not be used."""
INTERRUPTED = 128 + signal.SIGINT


def _run(name: str, arguments: list[str]) -> int:
    """Run a command; what ends it from outside, or a file that cannot be used, is one line."""
    # A module that serves several commands is told which one it is.
    shared = [m for m, _ in COMMANDS.values()].count(COMMANDS[name][0]) > 1
    try:
        module = importlib.import_module(f"juncnet_services.cli.{COMMANDS[name][0]}")
        return module.main(arguments if shared else arguments[1:])
    except KeyboardInterrupt as interrupt:  # its text, if any, says how to go on
        print("; ".join([f"\njuncnet {name}: interrupted", *interrupt.args]), file=sys.stderr)
        return INTERRUPTED
    except OSError as error:
        if error.filename is None:
            raise
        text = f"juncnet {name}: {error.filename}: {error.strerror}"
        remedy = REMEDIES.get(error.errno or 0)
        print(f"{text}: {remedy}" if remedy else text, file=sys.stderr)
        return 1 if error.errno == errno.ENOSPC else 2


def main() -> None:
    """Run the command named on the command line.

    Terminated (`timeout`, a closed terminal) it ends what it started, as with Ctrl-C.
    """
    for number in (signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(number) is signal.SIG_DFL:  # `nohup` has it ignored
            signal.signal(number, _end)
    arguments = sys.argv[1:]
    if not arguments or arguments[0] in ("-h", "--help"):
        print(_usage())
        raise SystemExit(0 if arguments else 2)
    name = arguments[0]
    if name not in COMMANDS:
        print(f"juncnet: there is no command {name!r}\n\n{_usage()}", file=sys.stderr)
        raise SystemExit(2)
    try:
        raise SystemExit(_run(name, arguments))
    except BaseException:
        if not _received:
            raise
    # All is cleaned up, but for what was under construction as the signal came; Python would wait
    # for the threads of a session that was opened and not yet given to anybody.
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(128 + _received[0])
