"""`juncnet compare DATA`: the paper's Table IV on your own pictures.

Trains kNN, SVM, 1-CNN/2-FCN, AlexNet, VGG and JuncNet (the paper's recipe, tuned, robust) on the
same pictures and tests them on unseen sites, on seen sites (the paper's protocol) and on any
further set. Writes models/compare-DATA.json, .md and .png after each of them.
"""

import argparse
import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from pydantic import ValidationError

from juncnet_services.cli.provenance import provenance
from juncnet_services.cli.train_extra import needs_train

if TYPE_CHECKING:
    from juncnet.learning.datasets import Dataset
    from juncnet.learning.evaluation.compare import Comparison


def arguments(argv: list[str]) -> argparse.Namespace:
    """Return the parsed command line."""
    parser = argparse.ArgumentParser(
        prog="juncnet compare",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("data", type=Path, help="a dataset whose pictures have sites")
    parser.add_argument(
        "--also", action="append", default=[], metavar="NAME=DATA", help="a further test set"
    )
    parser.add_argument("--name", help="of the data in tables (default: the folder's)")
    parser.add_argument("--epochs", type=float, default=8.0, help="of every network (default 8)")
    parser.add_argument("--limit", type=int, metavar="N", help="training pictures at most")
    parser.add_argument("--test-limit", type=int, metavar="N", help="of every column at most")
    parser.add_argument("--methods", help="only these, separated by semicolons")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--resume", action="store_true", help="keep what the file has already")
    parser.add_argument("--checkpoints", type=Path, help="a folder, to go on in mid-training")
    parser.add_argument("--out", type=Path, help="default: models/compare-DATA.json")
    parser.add_argument("--json", action="store_true", help="print the table as one object")
    return parser.parse_args(argv)


def main(argv: list[str]) -> int:
    """Train, test and write; 2 for bad arguments or data."""
    options = arguments(argv)
    with needs_train("juncnet compare"):
        from juncnet.learning.datasets import DatasetError, open_dataset
        from juncnet.learning.evaluation.classical import MissingLibraryError
        from juncnet.learning.evaluation.plots import PlotError
        from juncnet.learning.fit import CheckpointError
    name = options.name or options.data.resolve().name
    out: Path = options.out or Path("models") / f"compare-{name.replace(' ', '_')}.json"
    try:
        also = {title: open_dataset(path) for title, path in map(_pair, options.also)}
        _compare(options, name, open_dataset(options.data), also, out)
    except (DatasetError, MissingLibraryError, PlotError, CheckpointError, ValueError) as error:
        print(f"juncnet compare: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("juncnet compare: interrupted; go on with --resume", file=sys.stderr)
        return 1
    return 0


def _pair(text: str) -> tuple[str, Path]:
    title, mark, path = text.partition("=")
    if not (title and mark and path):
        raise ValueError(f"--also {text}: write it as NAME=DATA")
    return title, Path(path)


def _compare(
    options: argparse.Namespace, name: str, data: "Dataset", also: "dict[str, Dataset]", out: Path
) -> None:
    import torch

    from juncnet.features import Preprocessing
    from juncnet.learning.evaluation.compare import Comparison, columns_of, compete
    from juncnet.learning.evaluation.contestants import NAMES, Budget
    from juncnet.learning.evaluation.protocols import divided
    from juncnet.learning.pictures import prepared

    torch.set_num_threads(options.threads)
    wanted = tuple(options.methods.split(";")) if options.methods else NAMES
    unknown = [method for method in wanted if method not in NAMES]
    if unknown:
        raise ValueError(f"--methods {';'.join(unknown)}: there are {'; '.join(NAMES)}")
    parts = divided(data, options.limit, options.seed)
    train, validation = (prepared([p], Preprocessing()) for p in (parts.train, parts.validation))
    columns = columns_of(parts, also, options.test_limit)
    origin = provenance([])
    table = Comparison(
        data=name,
        command=_command(options, name),
        machine=f"{origin.cores} cores of {origin.cpu}",
        seed=options.seed,
        epochs=options.epochs,
        n_train=len(train),
        train_sites=len(set(parts.train.site.tolist())),
        n_validation=len(validation),
        entries=(),
    )
    table = _resumed(table, out) if options.resume else table

    for method in wanted:
        if method in {entry.name for entry in table.entries}:
            continue

        def progress(step: int, steps: int, method: str = method) -> None:
            if step % max(steps // 10, 1) == 0:
                print(f"{method}: step {step} of {steps}", file=sys.stderr, flush=True)

        budget = Budget(options.epochs, options.seed, options.checkpoints, progress)
        table = table.with_entry(compete(method, train, validation, columns, budget))
        _write(table, out)
    print(table.model_dump_json() if options.json else out.with_suffix(".md").read_text())


def _resumed(table: "Comparison", out: Path) -> "Comparison":
    """Return `table` with the entries that the file at `out` has of the same comparison."""
    if not out.exists():
        return table
    try:
        before = type(table).model_validate_json(out.read_text())
    except ValidationError as error:
        raise ValueError(f"{out} is no comparison: name another file with --out") from error
    for field in ("data", "seed", "epochs", "n_train", "train_sites", "n_validation"):
        if getattr(before, field) != getattr(table, field):
            raise ValueError(f"{out} has another {field}: name another file with --out")
    return table.model_copy(update={"entries": before.entries})


def _write(table: "Comparison", out: Path) -> None:
    from juncnet.learning.evaluation.compare_report import draw, markdown

    out.parent.mkdir(parents=True, exist_ok=True)
    out.write_text(table.model_dump_json(indent=1) + "\n")
    picture = out.with_suffix(".png")
    draw(table, picture)
    out.with_suffix(".md").write_text(markdown(table, picture.name))


def _command(options: argparse.Namespace, name: str) -> str:
    """Return the command as somebody else would type it: without this machine's folders."""
    words = ["juncnet", "compare", options.data.resolve().name]
    for title, path in map(_pair, options.also):
        words += ["--also", f"{title}={path.resolve().name}"]
    words += ["--name", name] if options.name else []
    words += ["--epochs", f"{options.epochs:g}"]
    for option in ("limit", "test_limit"):
        value = getattr(options, option)
        words += [f"--{option.replace('_', '-')}", str(value)] if value else []
    return shlex.join([*words, "--seed", str(options.seed)])
