"""When what was recorded comes again, and under which stamps. Pure."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any, TypeVar

from juncnet.clocks import NS_PER_S
from juncnet.messages import Message, Stamp
from juncnet.recording.reader import Recorded

M = TypeVar("M", bound=Message)


@dataclass(frozen=True)
class Shift:
    """From the time of a recording to that of its replay.

    `recorded_ns` on the recording's monotonic clock becomes `replayed_ns` on `clock`; from there
    on time passes `speed` times as fast. Epochs keep their order.
    """

    recorded_ns: int
    replayed_ns: int
    clock: str
    epoch: int
    """Of the replay; a source that had restarted gets the next one."""
    speed: float = 1.0
    epochs: tuple[int, ...] = ()
    """Epochs of the recording, oldest first."""

    def time_ns(self, recorded_ns: int) -> int:
        """Return when something of `recorded_ns` is replayed."""
        return max(0, self.replayed_ns + round((recorded_ns - self.recorded_ns) / self.speed))

    def stamp(self, stamp: Stamp) -> Stamp:
        """Return the stamp in the time of the replay."""
        older = sum(epoch < stamp.epoch for epoch in self.epochs)
        return replace(
            stamp,
            epoch=self.epoch + older,
            time_ns=self.time_ns(stamp.time_ns),
            clock=self.clock,
        )


def restamped(message: M, shift: Shift) -> M:
    """Return the message with every stamp in it, also within its parts, as `shift` says."""
    changes: dict[str, Any] = {}
    for name in type(message).model_fields:
        value = getattr(message, name)
        if isinstance(value, Stamp):
            changes[name] = shift.stamp(value)
        elif isinstance(value, Message):
            changed = restamped(value, shift)
            if changed is not value:
                changes[name] = changed
    return message.model_copy(update=changes) if changes else message


def due(items: Iterable[Recorded], speed: float) -> Iterator[tuple[float, Recorded]]:
    """Yield each item with the seconds after the first at which it is due."""
    first_ns: int | None = None
    for item in items:
        first_ns = item.time_ns if first_ns is None else first_ns
        yield (item.time_ns - first_ns) / NS_PER_S / speed, item


def epochs_of(items: Iterable[Recorded]) -> tuple[int, ...]:
    """Return the epochs of all headers, oldest first."""
    headers = (getattr(item.message, "header", None) for item in items)
    return tuple(sorted({h.epoch for h in headers if isinstance(h, Stamp)}))
