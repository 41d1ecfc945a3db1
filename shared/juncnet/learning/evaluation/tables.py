"""Markdown as all reports here write it."""

from collections.abc import Iterable, Sequence


def table_row(cells: Iterable[str]) -> str:
    """Return one line of a Markdown table."""
    return "| " + " | ".join(cells) + " |"


def table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a Markdown table with its head."""
    return "\n".join(table_row(row) for row in (heads, ["---"] * len(heads), *rows))


def percent(value: float | None, interval: tuple[float, float] | None = None) -> str:
    """Return a fraction as per cent with its interval; nothing known is an empty cell."""
    if value is None:
        return ""
    text = f"{100 * value:.2f} %"
    if interval is None:
        return text
    return f"{text} ({100 * interval[0]:.1f} to {100 * interval[1]:.1f})"
