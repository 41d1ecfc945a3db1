"""`juncnet train DATA ...`: train a model on labelled pictures and write it as an ONNX file.

DATA is a folder made by `juncnet dataset`, or a folder of class folders. Presets: `paper`, the
paper's network and recipe as stated; `tuned`, the same network with the recipe that serves it best;
`robust`, the best network and recipe found, faster on a CPU. Interrupt it with Ctrl-C, go on with
--resume.
"""

import argparse
import shlex
import signal
import sys
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING

from juncnet.assets import asset_path
from juncnet_services.cli.progress import Progress
from juncnet_services.cli.ranges import ending, make_room_for, positive, whole, why
from juncnet_services.cli.train_extra import needs_train

if TYPE_CHECKING:
    from juncnet.learning.recipes import Recipe
    from juncnet.learning.train import Order

FINE_TUNING_EPOCHS = 12.0
CHANGEABLE = ("epochs", "rate", "augmentation", "repeat_wrong", "mirror_mean")
"""Options that stand for the recipe's fields of the same names."""


def arguments(argv: list[str]) -> argparse.Namespace:
    """Return the parsed command line."""
    parser = argparse.ArgumentParser(
        prog="juncnet train",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("data", nargs="+", type=Path, metavar="DATA")
    parser.add_argument("--preset", choices=("paper", "tuned", "robust"), default="robust")
    parser.add_argument(
        "--from", dest="start", metavar="MODEL", help="go on from it: a file, or a shipped one"
    )
    parser.add_argument(
        "--out", type=ending(".onnx"), default=Path("my-juncnet.onnx"), metavar="FILE.onnx"
    )
    parser.add_argument("--name", help="of the model (default: the file's)")
    parser.add_argument(
        "--watch", type=Path, metavar="DATA", help="judge it along the way; it decides nothing"
    )
    parser.add_argument("--epochs", type=positive, help="instead of the preset's")
    parser.add_argument("--rate", type=positive, help="learning rate, instead of the preset's")
    parser.add_argument(
        "--augmentation", type=float, metavar="X", help="0 to 2, instead of the preset's"
    )
    parser.add_argument(
        "--mirror-mean",
        action=argparse.BooleanOptionalAction,
        help="whether `robust` answers the mean over picture and mirror image, in twice the time"
        " (default: no; with --from: as MODEL)",
    )
    parser.add_argument(
        "--repeat-wrong",
        type=int,
        metavar="TIMES",
        help="with --from: how often an epoch sees the pictures that MODEL is wrong about",
    )
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--threads", type=whole(1), default=2)
    parser.add_argument("--resume", action="store_true", help="go on where it was interrupted")
    parser.add_argument("--int8", action="store_true", help="store large weights as int8")
    return parser.parse_args(argv)


def main(argv: list[str]) -> int:
    """Train and write model, card and curve; 1 when interrupted, 2 for bad arguments or data."""
    options = arguments(argv)
    with needs_train("juncnet train"):
        import torch

        from juncnet.learning.datasets import DatasetError, open_dataset
        from juncnet.learning.fit import CheckpointError
        from juncnet.learning.train import Order, train
        from juncnet.learning.weights import WeightsError
        from juncnet.modelfile import ModelFileError
    torch.set_num_threads(options.threads)
    try:
        if options.start is not None:
            options.start = asset_path(options.start, "models", ".onnx")
        order = Order(
            recipe=_recipe(options),
            seed=options.seed,
            name=options.name or options.out.stem,
            out=options.out,
            start=options.start,
            int8=options.int8,
        )
        make_room_for(order.out)
        datasets = [open_dataset(path) for path in options.data]
        interrupted = _Interrupt()
        watched = open_dataset(options.watch) if options.watch else None
        outcome = train(
            datasets,
            order,
            options.resume,
            progress=Progress(),
            stop=interrupted.happened,
            watched=watched,
            judging=Progress("looking for what it gets wrong"),
        )
    except (
        DatasetError,
        WeightsError,
        CheckpointError,
        ModelFileError,
        ValueError,
        FileNotFoundError,
    ) as error:
        print(f"juncnet train: {why(error)}", file=sys.stderr)
        return 2
    if not outcome.finished:
        print("\ninterrupted: the same command with --resume goes on", file=sys.stderr)
        return 1
    _report(order, outcome, shlex.join(["juncnet", "train", *_shareable(argv)]))
    return 0


def _recipe(options: argparse.Namespace) -> "Recipe":
    """Return the preset with what the command line changes."""
    from juncnet.learning.recipes import PRESETS, Recipe
    from juncnet.learning.train import recipe_from

    recipe = PRESETS[options.preset]
    if options.start is not None:
        recipe = recipe_from(recipe, options.start)
        recipe = recipe.model_copy(update={"epochs": min(recipe.epochs, FINE_TUNING_EPOCHS)})
    elif options.repeat_wrong is not None:
        raise ValueError("--repeat-wrong needs --from MODEL: what is wrong is its answers")
    given = {name: getattr(options, name) for name in CHANGEABLE}
    changed = {name: value for name, value in given.items() if value is not None}
    return Recipe.model_validate({**recipe.model_dump(), **changed})


def _report(order: "Order", outcome: object, command: str) -> None:
    from juncnet.learning.curves import draw_curve
    from juncnet.learning.evaluation.plots import PlotError
    from juncnet.learning.train import Outcome, write_report

    assert isinstance(outcome, Outcome)
    write_report(order, outcome, command)
    written = [order.out, order.out.with_suffix(".md"), order.out.with_suffix(".json")]
    picture = order.out.with_name(order.out.stem + "-curve.png")
    try:
        draw_curve(outcome.curve, picture)
        written.append(picture)
    except PlotError as error:
        print(f"no picture of the curve: {error}", file=sys.stderr)
    shown = outcome.curve[-1]
    if order.recipe.keep_best:
        shown = max(outcome.curve, key=lambda point: point.balanced_accuracy)
    print(
        f"balanced accuracy {100 * shown.balanced_accuracy:.2f} % ({'; '.join(outcome.parts)}) "
        f"after {shown.samples} pictures"
    )
    print("wrote " + ", ".join(map(str, written)))


def _shareable(argv: list[str]) -> list[str]:
    """Return the arguments without this machine's folders."""
    return [Path(word).name if word.startswith("/") else word for word in argv]


class _Interrupt:
    """Remembers Ctrl-C, so that the step under way is finished and saved."""

    def __init__(self) -> None:
        self._seen = False
        signal.signal(signal.SIGINT, self._note)

    def _note(self, number: int, frame: FrameType | None) -> None:
        if self._seen:
            raise KeyboardInterrupt
        self._seen = True

    def happened(self) -> bool:
        return self._seen
