"""What a person has said about clips so far: marks, undo, and the intervals that follow from them.

A mark says *from here on it shows this class*. It holds until the next mark, or as far as the clip
was watched. An empty class means *leave this out*.
"""

from bisect import bisect_right
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from juncnet.learning.footage.intervals import Interval

SAME_S = 1e-3
"""Marks closer than this are on the same frame."""

Seconds = Annotated[float, Field(ge=0, allow_inf_nan=False)]


class _Action(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class OpenAction(_Action):
    """A clip is there to be labelled; known from before: it keeps what was said about it."""

    kind: Literal["open"] = "open"
    clip: str = Field(min_length=1)
    duration_s: Seconds
    site: str = ""
    """Where it was filmed, as far as its path tells."""


class MarkAction(_Action):
    """From `at_s` on the clip shows `label`; empty: leave out."""

    kind: Literal["mark"] = "mark"
    clip: str
    at_s: Seconds
    label: str = ""


class SiteAction(_Action):
    """The clip was filmed at `site`."""

    kind: Literal["site"] = "site"
    clip: str
    site: str = Field(max_length=80)


class UndoAction(_Action):
    """The last mark or site that still stands is taken back."""

    kind: Literal["undo"] = "undo"


class SeenAction(_Action):
    """The clip was watched up to `to_s`. This is not undone."""

    kind: Literal["seen"] = "seen"
    clip: str
    to_s: Seconds


Action = Annotated[
    OpenAction | MarkAction | SiteAction | UndoAction | SeenAction, Field(discriminator="kind")
]


@dataclass(frozen=True)
class Mark:
    """From `at_s` on the clip shows `label`; empty: leave out."""

    at_s: float
    label: str


@dataclass
class _Clip:
    duration_s: float
    site: str
    marks: list[Mark] = field(default_factory=list[Mark])
    seen_s: float = 0.0


class Labels:
    """The state that a sequence of actions leads to. The same actions give the same state."""

    def __init__(self, actions: Iterable[Action] = ()) -> None:
        """Start with what `actions` say.

        Raises:
            KeyError: an action is about a clip that was not opened before.
        """
        self._clips: dict[str, _Clip] = {}
        self._undo: list[tuple[str, list[Mark], str]] = []
        for action in actions:
            self.apply(action)

    @property
    def clips(self) -> Sequence[str]:
        """The names of all clips, in their order."""
        return list(self._clips)

    @property
    def undoable(self) -> int:
        """How many actions can be taken back."""
        return len(self._undo)

    def apply(self, action: Action) -> str:
        """Do what the action says and return the clip that it changed; empty: none.

        Raises:
            KeyError: the clip was not opened before.
        """
        match action:
            case OpenAction():
                known = self._clips.setdefault(action.clip, _Clip(action.duration_s, action.site))
                known.duration_s = action.duration_s
            case UndoAction():
                return self._take_back()
            case SeenAction():
                clip = self._clips[action.clip]
                clip.seen_s = max(clip.seen_s, min(action.to_s, clip.duration_s))
            case SiteAction():
                self._remember(action.clip)
                self._clips[action.clip].site = action.site
            case MarkAction():
                self._remember(action.clip)
                clip = self._clips[action.clip]
                clip.marks = _with(clip.marks, Mark(action.at_s, action.label))
                clip.seen_s = max(clip.seen_s, min(action.at_s, clip.duration_s))
        return action.clip

    def marks(self, clip: str) -> Sequence[Mark]:
        """Return the marks of a clip in order of time; neighbours differ in class."""
        return tuple(self._clips[clip].marks)

    def site(self, clip: str) -> str:
        """Return where a clip was filmed; empty: not said."""
        return self._clips[clip].site

    def seen_s(self, clip: str) -> float:
        """Return how far a clip was watched."""
        return self._clips[clip].seen_s

    def intervals(self, clip: str) -> list[Interval]:
        """Return what is said about a clip, up to where it was watched."""
        state = self._clips[clip]
        ends = [mark.at_s for mark in state.marks[1:]] + [state.seen_s]
        return [
            Interval(clip, mark.at_s, end, mark.label, state.site)
            for mark, end in zip(state.marks, ends, strict=False)
            if mark.label and end - mark.at_s > SAME_S
        ]

    def all_intervals(self) -> list[Interval]:
        """Return what is said about all clips, clip by clip."""
        return [interval for clip in self._clips for interval in self.intervals(clip)]

    def _remember(self, clip: str) -> None:
        state = self._clips[clip]
        self._undo.append((clip, list(state.marks), state.site))

    def _take_back(self) -> str:
        if not self._undo:
            return ""
        clip, marks, site = self._undo.pop()
        self._clips[clip].marks, self._clips[clip].site = marks, site
        return clip


def _with(marks: Sequence[Mark], new: Mark) -> list[Mark]:
    """Return `marks` with `new` in its place; marks that say nothing new are left out."""
    kept = [mark for mark in marks if abs(mark.at_s - new.at_s) > SAME_S]
    kept.insert(bisect_right([mark.at_s for mark in kept], new.at_s), new)
    return [m for i, m in enumerate(kept) if m.label != (kept[i - 1].label if i else "")]
