"""`juncnet curve REPORT.json ...`: AUC on watched pictures over all pictures seen in training.

REPORT.json is what `juncnet train --watch DATA` writes beside the model. Give several in their
order where each training went on from the model of the one before. Writes the curve as a picture
(PNG), and its points beside it as data (JSON).
"""

import argparse
import shlex
import sys
from pathlib import Path

from juncnet_services.cli.ranges import ending
from juncnet_services.cli.train_extra import needs_train


def arguments(argv: list[str]) -> argparse.Namespace:
    """Return the parsed command line."""
    parser = argparse.ArgumentParser(
        prog="juncnet curve",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("reports", nargs="+", type=Path, metavar="REPORT.json")
    parser.add_argument("--out", type=ending(".png"), default=Path("auc-over-training.png"))
    return parser.parse_args(argv)


def main(argv: list[str]) -> int:
    """Join the reports, draw and write; 2 for bad arguments or files."""
    options = arguments(argv)
    with needs_train("juncnet curve"):
        from juncnet.learning.curves import WatchedCurve, draw_watched, read_stretch
        from juncnet.learning.evaluation.plots import PlotError
    try:
        curve = WatchedCurve(
            command=shlex.join(["juncnet", "curve", *(path.name for path in options.reports)]),
            stretches=tuple(read_stretch(path) for path in options.reports),
        )
        data = options.out.with_suffix(".json")
        if data.resolve() in {path.resolve() for path in options.reports}:
            raise ValueError(f"--out {options.out}: its data would replace the report {data}")
        draw_watched(curve, options.out)
        data.write_text(curve.model_dump_json(indent=1) + "\n", encoding="utf-8")
    except (PlotError, OSError, ValueError) as error:
        print(f"juncnet curve: {error}", file=sys.stderr)
        return 2
    seen, area = curve.points[-1]
    print(f"AUC {area:.3f} after {seen} pictures; wrote {options.out}, {data}")
    return 0
