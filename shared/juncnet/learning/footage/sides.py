"""From samples and a user's rules to the split of every sample."""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase

from juncnet.learning.datasets import Row, Split
from juncnet.learning.footage.intervals import FootageError
from juncnet.learning.footage.selection import thinned
from juncnet.learning.footage.splits import FRACTIONS, deal_frames, deal_groups
from juncnet.learning.footage.writer import SplitBy


@dataclass(frozen=True)
class Rules:
    """How pictures are dealt out to the splits."""

    split_by: SplitBy = "site"
    shares: tuple[float, float, float] = FRACTIONS
    """Of train, validation and test."""
    validation: tuple[str, ...] = ()
    """Sites or clips of this split; `*` stands for anything."""
    test: tuple[str, ...] = ()
    train: tuple[str, ...] = ()
    seed: int = 0


def sides(samples: Sequence[Row], rules: Rules) -> list[Split]:
    """Return the split of every sample.

    Raises:
        FootageError: a rule names nothing, a site is asked for on two sides, or there are too few
            sites or clips; the text says what to do.
    """
    fixed = _fixed_clips(samples, rules)
    if rules.split_by == "frame":
        if fixed:
            raise FootageError("--seen-sites deals out single frames: name no sites or clips")
        return deal_frames([s.label for s in samples], rules.shares, rules.seed)
    group = {s.clip: s.site if rules.split_by == "site" else s.clip for s in samples}
    chosen: dict[str, Split] = {}
    for clip, split in fixed.items():
        if chosen.setdefault(group[clip], split) != split:
            raise FootageError(
                f"site {group[clip]} is asked for in {chosen[group[clip]]} and in {split}: "
                "use --split-by clip if the same places may stand on both sides"
            )
    counts: dict[str, Counter[str]] = {}
    for s in samples:
        counts.setdefault(group[s.clip], Counter())[s.label] += 1
    split_of = deal_groups(counts, chosen, rules.shares, rules.seed)
    return [split_of[group[s.clip]] for s in samples]


def within(samples: Sequence[Row], rules: Rules, limit: int | None) -> list[int]:
    """Return the samples that stay, in order: at most `limit` to learn from, and all of the test.

    Raises:
        FootageError: a rule names nothing, or a clip is asked for on two sides.
    """
    if limit is None:
        return list(range(len(samples)))
    fixed = _fixed_clips(samples, rules)
    learnt = [i for i, s in enumerate(samples) if fixed.get(s.clip) != "test"]
    kept = {learnt[i] for i in thinned([samples[i] for i in learnt], limit)}
    return [i for i, s in enumerate(samples) if i in kept or fixed.get(s.clip) == "test"]


def _fixed_clips(samples: Sequence[Row], rules: Rules) -> dict[str, Split]:
    """Return the clips for which a split is asked for: in the table so far, or by the rules."""
    fixed: dict[str, Split] = {}
    for s in samples:
        if s.split and fixed.setdefault(s.clip, s.split) != s.split:
            raise FootageError(f"{s.clip} is asked for in {fixed[s.clip]} and in {s.split}")
    for split, clips in clips_asked_for({(s.clip, s.site) for s in samples}, rules):
        for clip in clips:
            if fixed.setdefault(clip, split) != split:
                raise FootageError(f"{clip} is asked for in {fixed[clip]} and in {split}")
    return fixed


def clips_asked_for(
    there: Iterable[tuple[str, str]], rules: Rules
) -> list[tuple[Split, list[str]]]:
    """Return for every name in the rules its split and the clips that it means.

    `there` are clips with their sites.

    Raises:
        FootageError: a name means none of them.
    """
    names = sorted(there)
    asked: dict[Split, tuple[str, ...]] = {
        "train": rules.train,
        "validation": rules.validation,
        "test": rules.test,
    }
    found: list[tuple[Split, list[str]]] = []
    for split, patterns in asked.items():
        for pattern in patterns:
            matching = [c for c, site in names if _matches(pattern, c) or _matches(pattern, site)]
            if not matching:
                raise FootageError(f"no site or clip is called {pattern!r} (asked for in {split})")
            found.append((split, matching))
    return found


def _matches(pattern: str, name: str) -> bool:
    return fnmatchcase(name, pattern)
