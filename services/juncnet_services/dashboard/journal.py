"""Rows that a page has not seen yet: a bounded list in which every row has a serial number."""

from collections import deque
from collections.abc import Iterator
from typing import Generic, TypeVar

T = TypeVar("T")


class Journal(Generic[T]):
    """The newest `size` rows; ascending serials come from `serials`."""

    def __init__(self, serials: Iterator[int], size: int) -> None:
        self._serials = serials
        self._rows: deque[tuple[int, T]] = deque(maxlen=size)

    def add(self, row: T) -> None:
        """Append a row under the next serial."""
        self._rows.append((next(self._serials), row))

    def after(self, serial: int) -> list[T]:
        """Return the rows whose serial is higher than `serial`, oldest first."""
        found: list[T] = []
        for number, row in reversed(self._rows):
            if number <= serial:
                break
            found.append(row)
        return found[::-1]

    @property
    def last(self) -> T | None:
        """The newest row; None: there is none."""
        return self._rows[-1][1] if self._rows else None

    def clear(self) -> None:
        """Forget all rows."""
        self._rows.clear()
