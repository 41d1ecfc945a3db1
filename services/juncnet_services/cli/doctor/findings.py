"""What `juncnet doctor` finds: each thing looked at, how it is, and what to do about it."""

from collections.abc import Iterable
from enum import StrEnum

from pydantic import BaseModel, ConfigDict


class Level(StrEnum):
    """How a thing is."""

    OK = "ok"
    WARNING = "warning"
    """It can be flown with, knowingly."""
    FAILURE = "failure"
    """It cannot be flown with."""


class Finding(BaseModel):
    """One thing that was looked at."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    about: str
    level: Level
    text: str
    remedy: str = ""
    """What to do; empty only for what is in order."""


def ok(about: str, text: str) -> Finding:
    """Return a finding of what is in order."""
    return Finding(about=about, level=Level.OK, text=text)


def warning(about: str, text: str, remedy: str) -> Finding:
    """Return a finding of what can be flown with, knowingly."""
    return Finding(about=about, level=Level.WARNING, text=text, remedy=remedy)


def failure(about: str, text: str, remedy: str) -> Finding:
    """Return a finding of what cannot be flown with."""
    return Finding(about=about, level=Level.FAILURE, text=text, remedy=remedy)


def worst(findings: Iterable[Finding]) -> Level:
    """Return the worst level among `findings`."""
    levels = {finding.level for finding in findings}
    return next((x for x in (Level.FAILURE, Level.WARNING) if x in levels), Level.OK)


def lines(findings: Iterable[Finding]) -> Iterable[str]:
    """Yield what a person reads: a line a finding, and one below it with the remedy."""
    marks = {Level.OK: "ok   ", Level.WARNING: "WARN ", Level.FAILURE: "FAIL "}
    for finding in findings:
        yield f"{marks[finding.level]} {finding.about:<13} {finding.text}"
        if finding.remedy:
            yield f"{'':20}-> {finding.remedy}"
