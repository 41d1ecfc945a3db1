"""Scores in a model's card: one line a set, put in or replaced."""

from juncnet.learning.evaluation.report import Evaluation, area
from juncnet.learning.evaluation.tables import percent, table, table_row

TITLE = "## Scores"
HEADS = (
    *("set", "protocol", "pictures", "sites", "balanced accuracy", "AUC"),
    *("with transition band", "made by"),
)


def with_scores(card: str, e: Evaluation) -> str:
    """Return the text of a card with the line of this evaluation, in place of one of its set."""
    row = table_row(
        (
            e.data,
            e.protocol,
            str(e.n),
            str(e.sites),
            percent(e.balanced_accuracy, e.balanced_accuracy_interval),
            area(e.auc, e.auc_interval),
            percent(e.balanced_accuracy_with_band),
            f"`{e.command}`",
        )
    )
    before, title, after = card.partition(f"{TITLE}\n")
    if not title:
        note = "Intervals: 95 %, whole sites drawn with replacement."
        return f"{card.rstrip()}\n\n{TITLE}\n\n{note}\n\n{table(HEADS, [])}\n{row}\n"
    lines = after.splitlines()
    begin = end = next((i for i, line in enumerate(lines) if line.startswith("|")), len(lines))
    while end < len(lines) and lines[end].startswith("|"):
        end += 1
    mine = next((i for i in range(begin, end) if lines[i].startswith(f"| {e.data} |")), end)
    lines[mine : min(mine + 1, end)] = [row]
    return f"{before}{title}" + "\n".join(lines) + "\n"
