"""`juncnet dataset COMMAND`: pictures to learn from: film, extract, label, check, synthesise."""

import importlib
import sys

from juncnet.extras import install_command

COMMANDS = {
    "extract": ("extract", "frames from videos, labelled by folders or by intervals"),
    "label": ("label", "say what videos show: a page with one key a class"),
    "check": ("check", "counts, contact sheets, unreadable files, leaks between splits"),
    "synthesise": ("synthesise", "labelled pictures from simulated worlds"),
    "film": ("film", "videos of simulated drives with their intervals, to try this out"),
}

OUTSIDE = ("av", "cv2")
"""Packages that the base install does not have."""


def _usage() -> str:
    width = max(map(len, COMMANDS))
    rows = [f"  {name:<{width}}  {text}" for name, (_, text) in COMMANDS.items()]
    return "\n".join(["usage: juncnet dataset COMMAND [--help] ...", "", *rows])


def main(argv: list[str]) -> int:
    """Run the command named first; 2 when there is none of that name."""
    if not argv or argv[0] in ("-h", "--help"):
        print(_usage())
        return 0 if argv else 2
    if argv[0] not in COMMANDS:
        print(f"juncnet dataset: there is no command {argv[0]!r}\n\n{_usage()}", file=sys.stderr)
        return 2
    try:
        module = importlib.import_module(f"juncnet_services.cli.dataset.{COMMANDS[argv[0]][0]}")
    except ModuleNotFoundError as error:
        if error.name not in OUTSIDE:
            raise
        text = f"it needs {error.name}, of the extra [laptop]: {install_command('laptop')}"
        print(f"juncnet dataset {argv[0]}: {text}", file=sys.stderr)
        return 2
    answer: int = module.main(argv[1:])
    return answer
