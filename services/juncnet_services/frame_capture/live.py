"""A live camera: a thread drains the source, keeps the newest picture, and reconnects for ever."""

import threading
from collections import deque
from collections.abc import Callable, Generator, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field

from juncnet_services.frame_capture.contract import (
    UNITS_KEPT,
    AccessUnit,
    CameraError,
    Counts,
    Picture,
)
from juncnet_services.frame_capture.pacing import Backoff

CLOSE_S = 1.0


@dataclass
class Arrival:
    """What one packet of a live source has brought, perhaps nothing."""

    pictures: list[Picture] = field(default_factory=list[Picture])
    units: list[AccessUnit] = field(default_factory=list[AccessUnit])


Connect = Callable[[Counts], AbstractContextManager[Iterator[Arrival]]]
"""Opens the source; iterating it blocks, at most for the stall time. Raises `CameraError`."""


class LiveCamera:
    """Gives the newest picture of a source that `connect` opens, again and again if need be."""

    live = True
    ended = False

    def __init__(self, connect: Connect, ask_key_frame: Callable[[], None] | None = None) -> None:
        self.counts = Counts()
        self._ask_key_frame = ask_key_frame
        self._connect = connect
        self._picture: Picture | None = None
        self._units: deque[AccessUnit] = deque(maxlen=UNITS_KEPT)
        self._changed = threading.Condition()
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name="camera", daemon=True)
        self._thread.start()

    @contextmanager
    def take(self, timeout_s: float) -> Generator[Picture | None]:
        """Give the newest picture not taken yet; None after `timeout_s` or for units only.

        Raises:
            CameraError: the reading thread has died of something that no retry can help.
        """
        if not self._thread.is_alive():
            raise CameraError("the thread that reads the camera has died: see the log above")
        with self._changed:
            if self._picture is None and not self._units:
                self._changed.wait(timeout_s)
            picture, self._picture = self._picture, None
        yield picture

    def access_units(self) -> list[AccessUnit]:
        """Remove and return the access units that arrived; the oldest of too many are gone."""
        with self._changed:
            units = list(self._units)
            self._units.clear()
        return units

    def want_key_frame(self) -> None:
        """Ask the camera for a key frame, if it can be asked."""
        if self._ask_key_frame is not None:
            self._ask_key_frame()

    def close(self) -> None:
        """Ask the thread to end and wait for it a little: a blocked read ends by its time limit."""
        self._closing.set()
        self._thread.join(CLOSE_S)

    def _run(self) -> None:
        backoff = Backoff()
        been_connected = False
        while not self._closing.is_set():
            connected = False
            try:
                with self._connect(self.counts) as arrivals:
                    for arrival in arrivals:
                        if not connected:
                            connected = True
                            self.counts.reconnects += been_connected
                            been_connected = True
                            backoff.reset()
                        self._put(arrival)
                        if self._closing.is_set():
                            return
                problem = "the camera has ended its stream; is it still on?"
            except CameraError as error:
                problem = str(error)
            self._forget()
            delay_s = backoff.next_s()
            self.counts.problems.append(f"{problem}; next attempt in {delay_s:g} s")
            self._closing.wait(delay_s)

    def _forget(self) -> None:
        """Drop the picture that waits: once the source is back it would be an old one."""
        with self._changed:
            self.counts.late += self._picture is not None
            self._picture = None

    def _put(self, arrival: Arrival) -> None:
        if not arrival.pictures and not arrival.units:
            return
        with self._changed:
            self._units.extend(arrival.units)
            if arrival.pictures:
                replaced = self._picture is not None
                self.counts.late += len(arrival.pictures) - 1 + replaced
                self._picture = arrival.pictures[-1]
            self._changed.notify()
