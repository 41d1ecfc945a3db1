"""`juncnet ablate DATA`: what each step of the preprocessing is worth on your own pictures.

Trains the same network on the same pictures with one step changed at a time: grayscale only, Radon
only, sharpening, angles, filter, size, circle, standardisation. Tests on unseen sites, on seen
sites and on any further set. Writes models/ablate-DATA.json, .md and .png after each of them.
"""

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from juncnet_services.cli.train_extra import needs_train
from juncnet_services.cli.trained_table import (
    add_arguments,
    chosen_rows,
    fill_table,
    further_sets,
)

if TYPE_CHECKING:
    from juncnet.learning.evaluation.compare import Comparison, Entry
    from juncnet.learning.evaluation.contestants import Budget


def arguments(argv: list[str]) -> argparse.Namespace:
    """Return the parsed command line."""
    parser = argparse.ArgumentParser(
        prog="juncnet ablate",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add_arguments(parser, "ablate")
    parser.add_argument(
        "--preset",
        choices=("tuned", "robust"),
        default="tuned",
        help="tuned: the paper's network (default); robust: the better one, 64x64 only",
    )
    return parser.parse_args(argv)


def main(argv: list[str]) -> int:
    """Train, test and write; 2 for bad arguments or data."""
    options = arguments(argv)
    with needs_train("juncnet ablate"):
        from juncnet.learning.datasets import DatasetError
        from juncnet.learning.evaluation.plots import PlotError
        from juncnet.learning.fit import CheckpointError
    try:
        _ablate(options)
    except (DatasetError, PlotError, CheckpointError, ValueError) as error:
        print(f"juncnet ablate: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("juncnet ablate: interrupted; go on with --resume", file=sys.stderr)
        return 1
    return 0


def _ablate(options: argparse.Namespace) -> None:
    from juncnet.learning.datasets import open_dataset
    from juncnet.learning.evaluation.ablation import Subject, ablate, variants
    from juncnet.learning.evaluation.protocols import divided

    names = tuple(variants(options.preset))
    rows = chosen_rows(options, names)
    also = further_sets(options)
    parts = divided(open_dataset(options.data), options.limit, options.seed)
    subject = Subject(options.preset, parts, also, options.test_limit)

    def make(name: str, budget: "Budget") -> "Entry":
        return ablate(name, subject, budget)

    fill_table("ablate", options, parts, rows, names, make, _write)


def _write(table: "Comparison", out: Path) -> None:
    from juncnet.learning.evaluation.ablation import markdown
    from juncnet.learning.evaluation.compare_report import draw

    picture = out.with_suffix(".png")
    draw(table, picture, f"Preprocessing, {table.data}")
    out.with_suffix(".md").write_text(markdown(table, picture.name))
