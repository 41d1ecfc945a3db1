"""What benchmarks report: figures, printed as a table or as JSON."""

import json
from collections.abc import Sequence

from pydantic import BaseModel, ConfigDict


class Figure(BaseModel):
    """One measured figure and, where there is one, the target that it is held against."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: str
    value: float
    """The median where several were measured."""
    unit: str
    p99: float | None = None
    n: int | None = None
    """How many were measured."""
    target: float | None = None
    at_most: bool = False
    """Whether the target is an upper limit; else it is a lower one."""
    reached: bool | None = None
    """Whether the target is reached; None: there is none."""
    note: str = ""
    """What was compared, on how many threads, under which conditions."""

    @classmethod
    def against(
        cls,
        name: str,
        value: float,
        unit: str,
        target: float,
        at_most: bool = False,
        p99: float | None = None,
        n: int | None = None,
        note: str = "",
    ) -> "Figure":
        """Return a figure held against a target."""
        return cls(
            name=name,
            value=value,
            unit=unit,
            p99=p99,
            n=n,
            target=target,
            at_most=at_most,
            reached=value <= target if at_most else value >= target,
            note=note,
        )


def median(samples: Sequence[float]) -> float:
    """Return the middle of the samples, of an even number the upper one."""
    return sorted(samples)[len(samples) // 2]


def p99(samples: Sequence[float]) -> float:
    """Return the sample that 99 % do not exceed."""
    return sorted(samples)[min(len(samples) - 1, len(samples) * 99 // 100)]


def show(figures: Sequence[Figure], as_json: bool) -> None:
    """Print the figures: a JSON list, or a table for people."""
    if as_json:
        print(json.dumps([figure.model_dump() for figure in figures], indent=2))
        return
    print(table(figures))


def table(figures: Sequence[Figure]) -> str:
    """Return the figures as aligned lines."""
    width = max((len(figure.name) for figure in figures), default=0)
    lines = [
        f"{'figure':<{width}}  {'median':>10} {'p99':>10} unit    {'target':>10} reached  note"
    ]
    for f in figures:
        top = "" if f.p99 is None else f"{f.p99:.4g}"
        target = "" if f.target is None else f"{'<=' if f.at_most else '>='} {f.target:g}"
        reached = {None: "", True: "yes", False: "NO"}[f.reached]
        lines.append(
            f"{f.name:<{width}}  {f.value:>10.4g} {top:>10} {f.unit:<7} {target:>10} "
            f"{reached:<7}  {f.note}".rstrip()
        )
    return "\n".join(lines)
