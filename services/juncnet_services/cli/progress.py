"""How far a training is: one line that is renewed in a terminal, or a line for every twentieth."""

import sys
import time
from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from juncnet.learning.fit import Point

RENEWED_S = 0.2


class Progress:
    """Called after every step of one or more trainings, prints to standard error."""

    def __init__(self, title: str = "") -> None:
        """Begin; `title` stands before every line."""
        self._title = f"{title}: " if title else ""
        self._first = self._last = 0
        self._started = self._shown = 0.0
        self._live = sys.stderr.isatty()

    def __call__(self, step: int, steps: int, curve: "Sequence[Point]" = ()) -> None:
        """Show that `step` of `steps` is done and, where it is known, the last point of the curve.

        A training that was resumed begins at a later step; after another one it begins anew. Not
        every step need be told.
        """
        now = time.monotonic()
        if step <= self._last or not self._first:
            self._first, self._last, self._started = step, 0, now
        twentieth = max(steps // 20, 1)
        due = step // twentieth > self._last // twentieth or step == steps
        self._last = step
        if not due and (not self._live or now - self._shown < RENEWED_S):
            return
        self._shown = now
        done = step - self._first
        left = f", {(now - self._started) / done * (steps - step):.0f} s left" if done else ""
        bar = "█" * round(24 * step / steps)
        line = f"{bar:░<24} {step}/{steps}{left}{_found(curve)}"
        end = "\n" if not self._live or step == steps else ""
        renewed = "\r\x1b[2K" if self._live else ""
        print(renewed + self._title + line, end=end, file=sys.stderr, flush=True)


def _found(curve: "Sequence[Point]") -> str:
    if not curve:
        return ""
    last = curve[-1]
    loss = f"loss {last.loss:.3f}, " if last.samples else ""
    return f"  {loss}balanced accuracy {100 * last.balanced_accuracy:.2f} %"
