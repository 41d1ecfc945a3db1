"""What `juncnet compare` and `juncnet ablate` share: options, errors, going on, writing."""

import argparse
import shlex
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from pydantic import ValidationError

from juncnet_services.cli.progress import Progress
from juncnet_services.cli.provenance import provenance
from juncnet_services.cli.ranges import ending, keep_earlier, make_room_for, positive, whole
from juncnet_services.cli.train_extra import needs_train

if TYPE_CHECKING:
    from juncnet.learning.datasets import Dataset
    from juncnet.learning.evaluation.compare import Comparison, Entry
    from juncnet.learning.evaluation.contestants import Budget
    from juncnet.learning.evaluation.protocols import Parts

SAME = ("data", "preset", "seed", "epochs", "n_train", "train_sites", "n_validation")
"""What a file must have in common with a run that goes on with it."""
MakeEntry = Callable[[str, "Budget"], "Entry"]
"""Trains and tests the row of this name."""


@dataclass(frozen=True)
class Plan:
    """What a command fills its table with."""

    names: Sequence[str]
    """Of all rows, in the order of the table."""
    begin: "Callable[[Parts, Mapping[str, Dataset]], MakeEntry]"
    """From what is trained on, and the test sets by name, to what makes a row."""
    markdown: "Callable[[Comparison, str], str]"
    """Of a table and its picture's file name."""
    title: str
    """Of the picture; the name of the data follows."""


def table_parser(command: str, description: str | None) -> argparse.ArgumentParser:
    """Return the parser of a command that trains and tests on a dataset row by row."""
    parser = argparse.ArgumentParser(
        prog=f"juncnet {command}",
        description=description,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("data", type=Path, help="a dataset whose pictures have sites")
    parser.add_argument(
        "--also", action="append", default=[], metavar="NAME=DATA", help="a further test set"
    )
    parser.add_argument("--name", help="of the data in tables (default: the folder's)")
    parser.add_argument("--epochs", type=positive, default=8.0, help="of every network (default 8)")
    parser.add_argument("--limit", type=whole(2), metavar="N", help="training pictures at most")
    parser.add_argument("--test-limit", type=whole(2), metavar="N", help="of every column at most")
    parser.add_argument("--rows", help="only these, separated by semicolons")
    parser.add_argument("--seed", type=whole(0), default=0)
    parser.add_argument("--threads", type=whole(1), default=1)
    parser.add_argument("--resume", action="store_true", help="keep what the file has already")
    parser.add_argument("--checkpoints", type=Path, help="a folder, to go on in mid-training")
    parser.add_argument(
        "--out", type=ending(".json"), help="default: in models/, named for the data"
    )
    parser.add_argument("--json", action="store_true", help="print the table as one object")
    return parser


def make_table(
    command: str, options: argparse.Namespace, plan: Callable[[argparse.Namespace], Plan]
) -> int:
    """Make the table of a command; 1 when interrupted, 2 for bad arguments or data."""
    with needs_train(f"juncnet {command}"):
        from juncnet.learning.datasets import DatasetError
        from juncnet.learning.evaluation.classical import MissingLibraryError
        from juncnet.learning.evaluation.plots import PlotError
        from juncnet.learning.fit import CheckpointError
    try:
        _fill(command, options, plan(options))
    except (DatasetError, MissingLibraryError, PlotError, CheckpointError, ValueError) as error:
        print(f"juncnet {command}: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        raise KeyboardInterrupt("go on with --resume") from None
    return 0


def _fill(command: str, options: argparse.Namespace, plan: Plan) -> None:
    """Make the rows one by one, write the table after each, and print it."""
    import torch

    from juncnet.learning.datasets import open_dataset
    from juncnet.learning.evaluation.compare import judged_sets
    from juncnet.learning.evaluation.contestants import Budget
    from juncnet.learning.evaluation.protocols import divided

    torch.set_num_threads(options.threads)
    rows = _chosen_rows(options, plan.names)
    also = {title: open_dataset(path) for title, path in map(_pair, options.also)}
    parts = divided(open_dataset(options.data), options.limit, options.seed)
    sets = judged_sets(parts, also, options.test_limit)
    preset = f"-{options.preset}" if "preset" in options else ""
    out: Path = options.out or Path("models") / f"{command}-{_data_name(options)}{preset}.json"
    make_room_for(out)
    table = _table(command, options, parts, sets)
    if options.resume:
        table = _resumed(table, out, sets)
    else:
        keep_earlier(out)
    make = plan.begin(parts, sets)
    for row in rows:
        if row in {entry.name for entry in table.entries}:
            continue
        budget = Budget(options.epochs, options.seed, options.checkpoints, Progress(row))
        table = table.with_entry(make(row, budget), plan.names)
        _write(table, plan, out)
    print(table.model_dump_json() if options.json else out.with_suffix(".md").read_text())


def _write(table: "Comparison", plan: Plan, out: Path) -> None:
    from juncnet.learning.evaluation.compare_report import draw

    out.parent.mkdir(parents=True, exist_ok=True)
    out.write_text(table.model_dump_json(indent=1) + "\n")
    picture = out.with_suffix(".png")
    draw(table, picture, f"{plan.title}, {table.data}")
    out.with_suffix(".md").write_text(plan.markdown(table, picture.name))


def _data_name(options: argparse.Namespace) -> str:
    """Return what tables call the data."""
    return options.name or options.data.resolve().name


def _pair(text: str) -> tuple[str, Path]:
    title, mark, path = text.partition("=")
    if not (title and mark and path):
        raise ValueError(f"--also {text}: write it as NAME=DATA")
    return title, Path(path)


def _chosen_rows(options: argparse.Namespace, names: Sequence[str]) -> tuple[str, ...]:
    """Return the rows to make; ValueError: one is unknown."""
    wanted = tuple(options.rows.split(";")) if options.rows else tuple(names)
    unknown = [name for name in wanted if name not in names]
    if unknown:
        raise ValueError(f"--rows {';'.join(unknown)}: there are {'; '.join(names)}")
    return wanted


def _table(
    command: str, options: argparse.Namespace, parts: "Parts", sets: "Mapping[str, Dataset]"
) -> "Comparison":
    from juncnet.learning.datasets import sites_of
    from juncnet.learning.evaluation.compare import Comparison

    origin = provenance([])
    return Comparison(
        data=_data_name(options),
        preset=getattr(options, "preset", None),
        command=_command(command, options),
        machine=f"{origin.cores} cores of {origin.cpu}",
        seed=options.seed,
        epochs=options.epochs,
        n_train=len(parts.train),
        train_sites=len(set(parts.train.site.tolist())),
        n_validation=len(parts.validation),
        sites_unknown=tuple(name for name, data in sets.items() if not sites_of(data)[1]),
        entries=(),
    )


def _resumed(table: "Comparison", out: Path, sets: "Mapping[str, Dataset]") -> "Comparison":
    """Return `table` with the entries that the file at `out` has of the same training and test."""
    from juncnet.learning.evaluation.compare import sizes

    if not out.exists():
        return table
    try:
        before = type(table).model_validate_json(out.read_text())
    except ValidationError as error:
        raise ValueError(f"{out} is no table of this kind: name another with --out") from error
    for field in SAME:
        if getattr(before, field) != getattr(table, field):
            raise ValueError(f"{out} has another {field}: name another file with --out")
    wanted = sizes(sets)
    for entry in before.entries:
        if [(name, score.n, score.sites) for name, score in entry.columns.items()] != wanted:
            raise ValueError(
                f"{out}: {entry.name} was tested on other sets: give the same --also and "
                "--test-limit, or name another file with --out"
            )
    return table.model_copy(update={"entries": before.entries})


def _command(command: str, options: argparse.Namespace) -> str:
    """Return the command as somebody else would type it: without this machine's folders."""
    words = ["juncnet", command, options.data.resolve().name]
    for title, path in map(_pair, options.also):
        words += ["--also", f"{title}={path.resolve().name}"]
    words += ["--name", options.name] if options.name else []
    words += ["--preset", options.preset] if "preset" in options else []
    words += ["--epochs", f"{options.epochs:g}"]
    for option in ("limit", "test_limit"):
        value = getattr(options, option)
        words += [f"--{option.replace('_', '-')}", str(value)] if value else []
    return shlex.join([*words, "--seed", str(options.seed)])
