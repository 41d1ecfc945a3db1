"""`juncnet compare DATA`: the paper's Table IV on your own pictures.

Trains kNN, SVM, 1-CNN/2-FCN, AlexNet, VGG and JuncNet (the paper's recipe, tuned, robust) on the
same pictures and tests them on unseen sites, on seen sites (the paper's protocol) and on any
further set. Writes models/compare-DATA.json, .md and .png after each of them.
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
        prog="juncnet compare",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add_arguments(parser, "compare")
    return parser.parse_args(argv)


def main(argv: list[str]) -> int:
    """Train, test and write; 2 for bad arguments or data."""
    options = arguments(argv)
    with needs_train("juncnet compare"):
        from juncnet.learning.datasets import DatasetError
        from juncnet.learning.evaluation.classical import MissingLibraryError
        from juncnet.learning.evaluation.plots import PlotError
        from juncnet.learning.fit import CheckpointError
    try:
        _compare(options)
    except (DatasetError, MissingLibraryError, PlotError, CheckpointError, ValueError) as error:
        print(f"juncnet compare: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("juncnet compare: interrupted; go on with --resume", file=sys.stderr)
        return 1
    return 0


def _compare(options: argparse.Namespace) -> None:
    from juncnet.features import Preprocessing
    from juncnet.learning.datasets import open_dataset
    from juncnet.learning.evaluation.compare import columns_of, compete
    from juncnet.learning.evaluation.contestants import NAMES
    from juncnet.learning.evaluation.protocols import divided
    from juncnet.learning.pictures import prepared

    rows = chosen_rows(options, NAMES)
    also = further_sets(options)
    parts = divided(open_dataset(options.data), options.limit, options.seed)
    train, validation = (prepared([p], Preprocessing()) for p in (parts.train, parts.validation))
    columns = columns_of(parts, also, options.test_limit)

    def make(name: str, budget: "Budget") -> "Entry":
        return compete(name, train, validation, columns, budget)

    fill_table("compare", options, parts, rows, NAMES, make, _write)


def _write(table: "Comparison", out: Path) -> None:
    from juncnet.learning.evaluation.compare_report import draw, markdown

    picture = out.with_suffix(".png")
    draw(table, picture)
    out.with_suffix(".md").write_text(markdown(table, picture.name))
