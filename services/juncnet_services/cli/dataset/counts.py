"""How many pictures of which class a data set has, as a table for people."""

from collections import Counter
from collections.abc import Sequence

from juncnet.learning.datasets import Row
from juncnet.learning.footage.intervals import SPLITS, classes_of

UNDECIDED = "undecided"
"""What a picture's split is called while nobody has dealt it out."""
MOST_SITES = 60


def counts_table(samples: Sequence[Row]) -> str:
    """Return a table of classes by splits, with the number of sites and clips below."""
    counts = Counter((s.label, s.split) for s in samples)
    splits = [*SPLITS, ""] if any(not s.split for s in samples) else list(SPLITS)
    classes = classes_of(s.label for s in samples)
    width = max(len(name) for name in (*classes, "sites"))
    heads = [*(split or UNDECIDED for split in splits), "all"]
    lines = [f"{'':<{width}}" + "".join(f"{name:>12}" for name in heads)]

    def row(name: str, values: Sequence[int]) -> None:
        lines.append(f"{name:<{width}}" + "".join(f"{value:>12}" for value in values))

    for label in classes:
        by_split = [counts[label, split] for split in splits]
        row(label, [*by_split, sum(by_split)])
    for name, groups in (
        ("sites", [(s.site, s.split) for s in samples]),
        ("clips", [(s.clip, s.split) for s in samples]),
    ):
        by_split = [len({g for g, where in groups if where == split}) for split in splits]
        row(name, [*by_split, len({g for g, _ in groups})])
    return "\n".join(lines)


def site_table(samples: Sequence[Row]) -> str:
    """Return a table of sites: their splits and how many pictures of each class they have."""
    classes = classes_of(s.label for s in samples)
    sites = sorted({s.site for s in samples})
    width = max([len(site) for site in sites] + [4])
    counts = Counter((s.site, s.label) for s in samples)
    lines = [f"{'site':<{width}}" + "".join(f"{name:>14}" for name in classes) + "  splits"]
    for site in sites[:MOST_SITES]:
        splits = {s.split for s in samples if s.site == site}
        row = "".join(f"{counts[site, label]:>14}" for label in classes)
        lines.append(f"{site:<{width}}{row}  {', '.join(x for x in SPLITS if x in splits)}")
    if len(sites) > MOST_SITES:
        lines.append(f"and {len(sites) - MOST_SITES} sites more (--json lists them all)")
    return "\n".join(lines)
