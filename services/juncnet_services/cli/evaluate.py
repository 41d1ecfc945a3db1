"""`juncnet evaluate MODEL DATA`: how good a model is, with intervals, and where it errs.

DATA is a folder as `juncnet dataset` makes it, or a folder of class folders. Writes
models/evaluate-MODEL-DATA.json (all of it as one object), .md, and pictures: ROC, calibration and
confusion; the worst mistakes with their Radon reconstructions; the paper's Fig. 5.
"""

import argparse
import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from juncnet.assets import asset_path
from juncnet_services.cli.provenance import provenance
from juncnet_services.cli.ranges import ending
from juncnet_services.cli.train_extra import needs_train

if TYPE_CHECKING:
    from juncnet.learning.datasets import Dataset
    from juncnet.learning.evaluate import LoadedModel
    from juncnet.learning.evaluation.answers import Answers
    from juncnet.learning.evaluation.report import Evaluation


def arguments(argv: list[str]) -> argparse.Namespace:
    """Return the parsed command line."""
    parser = argparse.ArgumentParser(
        prog="juncnet evaluate",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("model", help="an ONNX file, or the name of one that is shipped")
    parser.add_argument("data", type=Path, help="a dataset")
    parser.add_argument(
        "--split", help="train, validation, test or all (default: test where there is one)"
    )
    parser.add_argument(
        "--sites",
        choices=("unseen", "seen"),
        help="whether the model was trained on these sites (default: what the splits say)",
    )
    parser.add_argument("--by", choices=("clip", "site"), default="clip", help="groups of figures")
    parser.add_argument("--name", help="of the data in tables (default: the folder's)")
    parser.add_argument(
        "--out", type=ending(".json"), help="default: models/evaluate-MODEL-DATA.json"
    )
    parser.add_argument("--json", action="store_true", help="print all of it as one object")
    parser.add_argument(
        "--pictures",
        choices=("all", "curves", "none"),
        default="all",
        help="curves: nothing that shows the data (where its licence does not let them be shown)",
    )
    parser.add_argument("--card", action="store_true", help="put the scores in the model's card")
    return parser.parse_args(argv)


def main(argv: list[str]) -> int:
    """Judge, write and print; 2 for bad arguments, models or data."""
    options = arguments(argv)
    with needs_train("juncnet evaluate"):
        from juncnet.learning.datasets import DatasetError, open_dataset
        from juncnet.learning.evaluate import load_model
        from juncnet.learning.evaluation.plots import PlotError
        from juncnet.learning.evaluation.protocols import PROTOCOLS, protocol_of
        from juncnet.learning.evaluation.report import evaluate

    name = options.name or options.data.resolve().name
    try:
        path = asset_path(options.model, "models", ".onnx")
        model = load_model(path)
        whole = open_dataset(options.data)
        split, data = _split(whole, options.split)
        origin = provenance([])
        evaluation, given = evaluate(
            model,
            data,
            name=name,
            split=split,
            protocol=PROTOCOLS.get(options.sites, protocol_of(whole, split)),
            command=_command(options, path),
            machine=f"{origin.cores} cores of {origin.cpu}",
            grouping=options.by,
        )
        out = options.out or Path("models") / f"evaluate-{path.stem}-{name.replace(' ', '_')}.json"
        _write(evaluation, given, model, data, out, options)
        if options.card:
            _write_card(evaluation, path.with_suffix(".md"))
    except (DatasetError, PlotError, FileNotFoundError, ValueError) as error:
        print(f"juncnet evaluate: {error}", file=sys.stderr)
        return 2
    return 0


def _split(data: "Dataset", wanted: str | None) -> "tuple[str, Dataset]":
    """Return the name of the split to judge and its pictures; ValueError: it has none."""
    there = sorted({str(name) for name in data.split} - {""})
    split = wanted or ("test" if "test" in there else "all")
    if split == "all":
        return split, data
    if split not in there:
        raise ValueError(f"--split {split}: the data have {', '.join([*there, 'all'])}")
    return split, data.where(data.split == split)


def _command(options: argparse.Namespace, model: Path) -> str:
    """Return the command as somebody else would type it: without this machine's folders."""
    words = ["juncnet", "evaluate", model.stem, options.data.resolve().name]
    for name in ("split", "name", "sites"):
        value = getattr(options, name)
        words += [f"--{name}", value] if value else []
    words += ["--by", options.by] if options.by != "clip" else []
    return shlex.join(words)


def _write(
    evaluation: "Evaluation",
    given: "Answers",
    model: "LoadedModel",
    data: "Dataset",
    out: Path,
    options: argparse.Namespace,
) -> None:
    from juncnet.learning.evaluation.drawings import draw_figures, draw_mistakes, draw_stages
    from juncnet.learning.evaluation.report import markdown

    out.parent.mkdir(parents=True, exist_ok=True)
    title = f"{evaluation.model} on {evaluation.data}, {evaluation.protocol}"
    pictures: dict[str, Path] = {}
    if options.pictures != "none":
        path = pictures["ROC, calibration, confusion"] = out.with_suffix(".png")
        draw_figures(given, evaluation, title, path)
    if options.pictures == "all":
        preprocessing = model.metadata.preprocessing
        path = out.with_name(f"{out.stem}-mistakes.png")
        pictures["Worst mistakes and their reconstructions"] = path
        draw_mistakes(given, data, preprocessing, f"{title}: surest mistakes", path)
        path = out.with_name(f"{out.stem}-fig5.png")
        pictures["Grayscale, sharpened, reconstruction"] = path
        draw_stages(data, preprocessing, f"{evaluation.data}: as the paper's Fig. 5", path)
    out.write_text(evaluation.model_dump_json(indent=1) + "\n")
    text = markdown(evaluation, pictures)
    out.with_suffix(".md").write_text(text)
    print(evaluation.model_dump_json() if options.json else text)


def _write_card(evaluation: "Evaluation", card: Path) -> None:
    from juncnet.learning.evaluation.card import with_scores

    text = card.read_text() if card.exists() else f"# {evaluation.model}\n"
    card.write_text(with_scores(text, evaluation))
