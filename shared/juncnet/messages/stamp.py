"""Stamps: who made something, as which in a row, and when."""

import re
from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar, Final

from pydantic import ConfigDict, Field

from juncnet.clocks import Instant
from juncnet.messages.base import NAME_LENGTH, NAME_PATTERN, Message, Name

LIMIT = 2**63


@dataclass(slots=True, unsafe_hash=True)
class Stamp:
    """Who made something, as which in a row, and when: source epoch, sequence, time and its clock.

    A frame's stamp says when it was captured and travels unchanged, as `header`, with all that
    follows from it. A command's stamp, `issued`, says when it was decided. The epoch is the
    monotonic time in nanoseconds at which the source started: on the same clock a restarted source
    has a newer one, whatever was done to the wall clock meanwhile.

    Part of messages, and no model itself: a frame takes one on either side of its hop, where a
    model that is built once a frame, its code no longer in the caches, costs 0.03 ms. Its fields
    are final for type checkers only: setting them past a frozen class costs each hop, too.

    Raises:
        ValueError: a number is not in [0, 2**63) or `clock` is no name; the text names the field.
    """

    __pydantic_config__: ClassVar = ConfigDict(extra="forbid")

    epoch: Final[int]
    sequence: Final[int]
    time_ns: Final[int]
    """Monotonic nanoseconds on `clock`."""
    clock: Final[str]
    uncertainty_ns: Final[int] = 0

    def __post_init__(self) -> None:
        if not (
            0 <= self.epoch < LIMIT
            and 0 <= self.sequence < LIMIT
            and 0 <= self.time_ns < LIMIT
            and 0 <= self.uncertainty_ns < LIMIT
        ):
            self._refuse()
        _check_clock(self.clock)

    def _refuse(self) -> None:
        for name in ("epoch", "sequence", "time_ns", "uncertainty_ns"):
            value = getattr(self, name)
            if not 0 <= value < LIMIT:
                raise ValueError(f"{name}: {value} is not in [0, 2**63)")

    @property
    def instant(self) -> Instant:
        """The time of this stamp as `juncnet.clocks` takes it."""
        return Instant(self.time_ns, self.clock, self.uncertainty_ns)


@lru_cache(maxsize=64)
def _check_clock(clock: str) -> None:
    if len(clock) > NAME_LENGTH or re.fullmatch(NAME_PATTERN, clock) is None:
        raise ValueError(
            f"clock: {clock[:140]!r} is not {NAME_PATTERN} of at most {NAME_LENGTH} characters"
        )


class ClockReading(Message):
    """What a clock shows: the answer to who asks for its time."""

    clock: Name
    time_ns: int = Field(ge=0, lt=LIMIT)
