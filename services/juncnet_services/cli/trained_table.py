"""What `juncnet compare` and `juncnet ablate` share: options, going on, writing after each row."""

import argparse
import shlex
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from pydantic import ValidationError

from juncnet_services.cli.provenance import provenance

if TYPE_CHECKING:
    from juncnet.learning.datasets import Dataset
    from juncnet.learning.evaluation.compare import Comparison, Entry
    from juncnet.learning.evaluation.contestants import Budget
    from juncnet.learning.evaluation.protocols import Parts

SAME = ("data", "seed", "epochs", "n_train", "train_sites", "n_validation")
"""What a file must have in common with a run that goes on with it."""


def add_arguments(parser: argparse.ArgumentParser, command: str) -> None:
    """Add the options of a command that trains and tests on a dataset row by row."""
    parser.add_argument("data", type=Path, help="a dataset whose pictures have sites")
    parser.add_argument(
        "--also", action="append", default=[], metavar="NAME=DATA", help="a further test set"
    )
    parser.add_argument("--name", help="of the data in tables (default: the folder's)")
    parser.add_argument("--epochs", type=float, default=8.0, help="of every network (default 8)")
    parser.add_argument("--limit", type=int, metavar="N", help="training pictures at most")
    parser.add_argument("--test-limit", type=int, metavar="N", help="of every column at most")
    parser.add_argument("--rows", help="only these, separated by semicolons")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--resume", action="store_true", help="keep what the file has already")
    parser.add_argument("--checkpoints", type=Path, help="a folder, to go on in mid-training")
    parser.add_argument("--out", type=Path, help=f"default: models/{command}-DATA.json")
    parser.add_argument("--json", action="store_true", help="print the table as one object")


def data_name(options: argparse.Namespace) -> str:
    """Return what tables call the data."""
    return options.name or options.data.resolve().name


def further_sets(options: argparse.Namespace) -> "dict[str, Dataset]":
    """Return the sets of `--also`; ValueError or DatasetError where one is wrong."""
    from juncnet.learning.datasets import open_dataset

    return {title: open_dataset(path) for title, path in map(_pair, options.also)}


def _pair(text: str) -> tuple[str, Path]:
    title, mark, path = text.partition("=")
    if not (title and mark and path):
        raise ValueError(f"--also {text}: write it as NAME=DATA")
    return title, Path(path)


def chosen_rows(options: argparse.Namespace, names: Sequence[str]) -> tuple[str, ...]:
    """Return the rows to make; ValueError: one is unknown."""
    wanted = tuple(options.rows.split(";")) if options.rows else tuple(names)
    unknown = [name for name in wanted if name not in names]
    if unknown:
        raise ValueError(f"--rows {';'.join(unknown)}: there are {'; '.join(names)}")
    return wanted


def fill_table(
    command: str,
    options: argparse.Namespace,
    parts: "Parts",
    rows: Sequence[str],
    order: Sequence[str],
    make: "Callable[[str, Budget], Entry]",
    write: "Callable[[Comparison, Path], None]",
) -> None:
    """Make the rows one by one, write the table after each, and print it.

    Args:
        command: its name.
        options: as parsed.
        parts: what is trained on.
        rows: names of those to make.
        order: of all names in the table.
        make: trains and tests one of them.
        write: what else is written beside the JSON.
    """
    import torch

    from juncnet.learning.evaluation.contestants import Budget

    torch.set_num_threads(options.threads)
    out: Path = options.out or Path("models") / f"{command}-{data_name(options)}.json"
    table = _table(command, options, parts)
    table = _resumed(table, out) if options.resume else table
    for row in rows:
        if row in {entry.name for entry in table.entries}:
            continue

        def progress(step: int, steps: int, row: str = row) -> None:
            if step % max(steps // 10, 1) == 0:
                print(f"{row}: step {step} of {steps}", file=sys.stderr, flush=True)

        budget = Budget(options.epochs, options.seed, options.checkpoints, progress)
        table = table.with_entry(make(row, budget), order)
        out.parent.mkdir(parents=True, exist_ok=True)
        out.write_text(table.model_dump_json(indent=1) + "\n")
        write(table, out)
    print(table.model_dump_json() if options.json else out.with_suffix(".md").read_text())


def _table(command: str, options: argparse.Namespace, parts: "Parts") -> "Comparison":
    from juncnet.learning.evaluation.compare import Comparison

    origin = provenance([])
    return Comparison(
        data=data_name(options),
        command=_command(command, options),
        machine=f"{origin.cores} cores of {origin.cpu}",
        seed=options.seed,
        epochs=options.epochs,
        n_train=len(parts.train),
        train_sites=len(set(parts.train.site.tolist())),
        n_validation=len(parts.validation),
        entries=(),
    )


def _resumed(table: "Comparison", out: Path) -> "Comparison":
    """Return `table` with the entries that the file at `out` has of the same training."""
    if not out.exists():
        return table
    try:
        before = type(table).model_validate_json(out.read_text())
    except ValidationError as error:
        raise ValueError(f"{out} is no table of this kind: name another with --out") from error
    for field in SAME:
        if getattr(before, field) != getattr(table, field):
            raise ValueError(f"{out} has another {field}: name another file with --out")
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
