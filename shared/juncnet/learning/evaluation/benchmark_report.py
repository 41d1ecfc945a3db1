"""The tables of `juncnet benchmark` as data, Markdown and learning curves."""

from pathlib import Path

from pydantic import BaseModel, ConfigDict

from juncnet.learning.evaluation.benchmark import AIMS, Row
from juncnet.learning.evaluation.plots import drawing
from juncnet.learning.evaluation.small_pictures import limits_text
from juncnet.learning.evaluation.tables import table_row

ORDER = ("paper", "tuned")
HEADS = (
    *("recipe", "seeds", "test accuracy", "error", "95 % (test size)", "held out"),
    *("trained on", "aim"),
)


class BenchmarkReport(BaseModel):
    """All rows for one set of pictures."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    data: str
    """The set's name as tables call it."""
    machine: str
    rows: tuple[Row, ...]

    def with_row(self, row: Row) -> "BenchmarkReport":
        """Return the report with this row in place of the one of the same recipe."""
        others = [other for other in self.rows if other.name != row.name]
        rows = sorted([*others, row], key=lambda r: ORDER.index(r.name))
        return self.model_copy(update={"rows": tuple(rows)})


def markdown(report: BenchmarkReport, picture: str) -> str:
    """Return the report as Markdown; `picture` is the file name of its curves."""
    aim = AIMS.get(report.data)
    lines = [
        f"# {report.data}: the paper's network",
        "",
        "`PaperNet` as for roads, only input channels and classes differ; every picture enlarged "
        "to 64x64, sharpened, with its Radon reconstruction. Chosen on a held-out part of the "
        "training pictures; the test pictures were used once a run.",
        "",
        table_row(HEADS),
        table_row(["---"] * len(HEADS)),
    ]
    for row in report.rows:
        low, high = row.interval
        spread = "" if row.spread is None else f" ± {100 * row.spread:.2f} (seeds)"
        reached = "" if aim is None else f"{100 * aim:.2f} %: {_reached(row.accuracy, aim)}"
        cells = [
            row.name,
            str(len(row.runs)),
            f"{100 * row.accuracy:.2f} %{spread}",
            f"{100 * (1 - row.accuracy):.2f} %",
            f"{100 * low:.2f} to {100 * high:.2f} %",
            f"{100 * row.held_out_accuracy:.2f} %",
            f"{row.n_train} pictures, {row.length}",
            reached,
        ]
        lines.append(table_row(cells))
    lines += ["", f"![Learning curves]({picture})", ""]
    for row in report.rows:
        lines += [
            f"*{row.name}*: {row.recipe.describe()}{_moved(row)}; {row.length}; "
            f"{row.weights} weights; "
            f"tested on {row.n_test} pictures, on {report.machine}.",
            f"`{row.command}`",
            "",
        ]
    return "\n".join(lines)


def _moved(row: Row) -> str:
    strength = row.recipe.augmentation
    return f": {limits_text(strength)}" if strength else ""


def _reached(value: float, aim: float) -> str:
    return "reached" if value >= aim else f"missed by {100 * (aim - value):.2f} points"


def draw_curves(report: BenchmarkReport, path: Path) -> None:
    """Draw the held-out accuracy of every run over the pictures seen, with the paper's figure."""
    with drawing(path, 7, 4) as figure:
        axes = figure.add_subplot()
        for row in report.rows:
            for run in row.runs:
                test = f"test {100 * run.test_accuracy:.2f} %"
                axes.plot(
                    [point.samples for point in run.curve],
                    [100 * point.held_out_accuracy for point in run.curve],
                    marker=".",
                    label=f"{row.name}, seed {run.seed}: {test}",
                )
        if report.data in AIMS:
            axes.axhline(100 * AIMS[report.data], color="grey", ls=":", label="the paper (test)")
        axes.set(
            xlabel="training pictures seen",
            ylabel="held-out accuracy, %",
            title=f"{report.data}: the paper's network",
        )
        axes.grid(alpha=0.3)
        axes.legend()
