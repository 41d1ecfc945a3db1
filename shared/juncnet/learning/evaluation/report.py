"""`juncnet evaluate` as one object and as Markdown."""

from pathlib import Path

from juncnet.learning.datasets import Dataset, sites_of
from juncnet.learning.evaluate import (
    Grouping,
    LoadedModel,
    answers,
    latency,
    with_band,
)
from juncnet.learning.evaluation.answers import Answers
from juncnet.learning.evaluation.protocols import Protocol
from juncnet.learning.evaluation.scores import Scores, score
from juncnet.learning.evaluation.tables import percent, table

SHOWN_GROUPS = 20
"""More are in the JSON only."""


class Evaluation(Scores):
    """How a model does on a set, and where that comes from."""

    model: str
    model_sha256: str
    data: str
    """Name of the set."""
    split: str
    """Of the set; `all`: the whole of it."""
    protocol: Protocol
    balanced_accuracy_with_band: float | None
    """Pictures of the transition band judged as well, by the middle of its ramp."""
    command: str
    machine: str


def evaluate(
    model: LoadedModel,
    data: Dataset,
    *,
    name: str,
    split: str,
    protocol: Protocol,
    command: str,
    machine: str,
    grouping: Grouping = "clip",
) -> tuple[Evaluation, Answers]:
    """Return all figures of a model on a set, and the answers that they are made from.

    Raises:
        ValueError: nothing to judge, or classes that cannot be compared.
        DatasetError: a picture cannot be read.
    """
    given = answers(model, data, grouping)
    figures = score(given, sites_known=sites_of(data)[1])
    evaluation = Evaluation(
        **figures.model_dump(exclude={"latency"}),
        latency=latency(model, data),
        model=model.name,
        model_sha256=model.sha256,
        data=name,
        split=split,
        protocol=protocol,
        balanced_accuracy_with_band=with_band(given, data),
        command=command,
        machine=machine,
    )
    return evaluation, given


def markdown(e: Evaluation, pictures: dict[str, Path]) -> str:
    """Return an evaluation as Markdown; `pictures` are shown by their titles."""
    lines = [
        f"# {e.model} on {e.data}",
        "",
        f"{e.n} pictures of {e.sites} sites, split *{e.split}*, **{e.protocol}**. Intervals: 95 %, "
        "whole sites drawn with replacement.",
        "",
        table(("figure", "value"), _figures(e)),
        "",
        table(
            ("truth \\ answer", *e.classes, "recall", "precision", "F1"),
            [
                (
                    name,
                    *(str(cell) for cell in row),
                    percent(e.per_class[name].recall),
                    percent(e.per_class[name].precision),
                    percent(e.per_class[name].f1),
                )
                for name, row in zip(e.classes, e.confusion, strict=True)
            ],
        ),
        "",
    ]
    if 0 < len(e.groups) <= SHOWN_GROUPS:
        rows = [
            (
                name,
                str(g.n),
                str(g.sites),
                percent(g.accuracy, g.accuracy_interval),
                percent(g.balanced_accuracy, g.balanced_accuracy_interval),
                area(g.auc, g.auc_interval),
            )
            for name, g in e.groups.items()
        ]
        heads = ("group", "pictures", "sites", "accuracy", "balanced accuracy", "AUC")
        lines += [table(heads, rows), ""]
    lines += [f"- {note}" for note in e.notes] + [""] * bool(e.notes)
    for title, path in pictures.items():
        lines += [f"![{title}]({path.name})", ""]
    lines += [f"Made by `{e.command}` on {e.machine}; model sha256 `{e.model_sha256}`.", ""]
    return "\n".join(lines)


def _figures(e: Evaluation) -> list[tuple[str, str]]:
    rows = [
        ("accuracy", percent(e.accuracy, e.accuracy_interval)),
        ("balanced accuracy", percent(e.balanced_accuracy, e.balanced_accuracy_interval)),
        ("AUC", area(e.auc, e.auc_interval)),
        ("F1", area(e.f1, e.f1_interval)),
        (
            "calibration error (ECE)",
            percent(e.calibration_error, e.calibration_error_interval),
        ),
    ]
    if e.n_no_class:
        called = ", ".join(f"{100 * p:.0f} % {name}" for name, p in e.no_class_called.items())
        rows.append(("in no class (transition)", f"{e.n_no_class}: called {called}"))
    if e.balanced_accuracy_with_band is not None:
        rows.append(("balanced accuracy with them", percent(e.balanced_accuracy_with_band)))
    if e.latency is not None:
        at = e.latency
        rows.append(
            (
                "latency, one thread",
                f"{at.total_p50_ms:.2f} ms median, {at.total_p99_ms:.2f} ms p99 "
                f"(features {at.features_p50_ms:.2f}, network {at.network_p50_ms:.2f}; n={at.n}, "
                f"load {at.load:.1f})",
            )
        )
    return rows


def area(value: float | None, interval: tuple[float, float] | None) -> str:
    """Return a figure between 0 and 1 with three digits and its interval."""
    if value is None:
        return ""
    return f"{value:.3f}" + (f" ({interval[0]:.2f} to {interval[1]:.2f})" if interval else "")
