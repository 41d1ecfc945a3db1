"""`juncnet benchmark mnist DIR | cifar10 FILE`: the paper's Tables II and III with its network.

DIR has MNIST's four IDX files; FILE is `cifar-10-binary.tar.gz` or an `.npz` of JPEG copies. A run
that is interrupted goes on from its checkpoint: the same command again.
"""

import argparse
import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from pydantic import ValidationError

from juncnet_services.cli.progress import Progress
from juncnet_services.cli.provenance import provenance
from juncnet_services.cli.ranges import ending, make_room_for, positive, whole, why
from juncnet_services.cli.train_extra import needs_train

if TYPE_CHECKING:
    from juncnet.learning.evaluation.benchmark_report import BenchmarkReport


def arguments(argv: list[str]) -> argparse.Namespace:
    """Return the parsed command line."""
    parser = argparse.ArgumentParser(
        prog="juncnet benchmark",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("set", choices=("mnist", "cifar10"))
    parser.add_argument("data", type=Path, metavar="DIR|FILE")
    parser.add_argument("--recipe", choices=("paper", "tuned"), default="tuned")
    parser.add_argument(
        "--epochs", type=positive, help="fewer than the recipe's (said in the table)"
    )
    parser.add_argument("--seeds", default="0", help="for instance 0,1,2 (default 0)")
    parser.add_argument(
        "--limit", type=whole(2), metavar="N", help="use N pictures only, for trials"
    )
    parser.add_argument("--threads", type=whole(1), default=1)
    parser.add_argument("--checkpoints", type=Path, help="default: in the user's cache")
    parser.add_argument("--out", type=ending(".json"), help="default: models/benchmark-SET.json")
    parser.add_argument("--json", action="store_true", help="print the report as one object")
    return parser.parse_args(argv)


def main(argv: list[str]) -> int:
    """Train, test once and write the table; 2 for bad arguments or files."""
    options = arguments(argv)
    with needs_train("juncnet benchmark"):
        import torch

        from juncnet.learning.evaluation.benchmark import RECIPES, Settings, run_row
        from juncnet.learning.evaluation.image_sets import ImageSetError, load_cifar10, load_mnist
        from juncnet.learning.fit import CheckpointError
        from juncnet.radon_cache import cache_directory

    torch.set_num_threads(options.threads)
    out: Path = options.out or Path("models") / f"benchmark-{options.set}.json"
    try:
        recipe = RECIPES[options.recipe]
        recipe = recipe.model_copy(update={"epochs": options.epochs or recipe.epochs})
        settings = Settings(
            name=options.recipe,
            recipe=recipe,
            seeds=_seeds(options.seeds),
            checkpoints=options.checkpoints or cache_directory() / "benchmark",
        )
        load = load_mnist if options.set == "mnist" else load_cifar10
        images = load(options.data).limited(options.limit)
        report = _report(out, images.name)
        make_room_for(out)
        row = run_row(images, settings, _command(options), Progress())
    except (ImageSetError, CheckpointError, ValueError) as error:
        print(f"juncnet benchmark: {why(error)}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        raise KeyboardInterrupt("the same command goes on") from None
    _write(report.with_row(row), out, options.json)
    return 0


def _seeds(text: str) -> tuple[int, ...]:
    seeds = text.split(",")
    if not all(map(str.isdecimal, seeds)):
        raise ValueError(f"--seeds {text}: write them as 0,1,2")
    return tuple(map(int, seeds))


def _command(options: argparse.Namespace) -> str:
    """Return the command as somebody else would type it: without this machine's folders."""
    words = ["juncnet", "benchmark", options.set, options.data.resolve().name]
    words += ["--recipe", options.recipe, "--seeds", options.seeds]
    words += ["--epochs", f"{options.epochs:g}"] if options.epochs else []
    return shlex.join(words + (["--limit", str(options.limit)] if options.limit else []))


def _report(out: Path, name: str) -> "BenchmarkReport":
    """Return the report that is at `out`, or a new one; ValueError: another kind of file."""
    from juncnet.learning.evaluation.benchmark_report import BenchmarkReport

    origin = provenance([])
    machine = f"{origin.cores} cores of {origin.cpu}"
    if not out.exists():
        return BenchmarkReport(data=name, machine=machine, rows=())
    try:
        before = BenchmarkReport.model_validate_json(out.read_text())
    except ValidationError as error:
        raise ValueError(f"{out} is no report of a benchmark: name another with --out") from error
    if before.data != name:
        raise ValueError(f"{out} is about {before.data}: name another file with --out")
    return before.model_copy(update={"machine": machine})


def _write(report: "BenchmarkReport", out: Path, as_json: bool) -> None:
    from juncnet.learning.evaluation.benchmark_report import draw_curves, markdown

    out.parent.mkdir(parents=True, exist_ok=True)
    out.write_text(report.model_dump_json(indent=1) + "\n")
    picture = out.with_suffix(".png")
    draw_curves(report, picture)
    text = markdown(report, picture.name)
    out.with_suffix(".md").write_text(text)
    print(report.model_dump_json() if as_json else text)
