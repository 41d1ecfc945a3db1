"""The simulator's camera: pictures that come ready, with the stamp of the camera that took them."""

from collections.abc import Generator
from contextlib import contextmanager
from functools import partial

from juncnet.frames import FrameReader
from juncnet_services.frame_capture.contract import AccessUnit, Counts, Picture
from juncnet_services.frame_capture.planes import write_pixels


class SimulatedCamera:
    """Gives what the simulator rendered; the header keeps the simulator's capture stamp.

    Not `live` in the sense of the frozen check: a simulated robot at rest has truly equal pictures.
    """

    live = False
    ended = False

    def __init__(self, reader: FrameReader) -> None:
        self.counts = Counts()
        self._reader = reader
        self._newest = (-1, -1)

    @contextmanager
    def take(self, timeout_s: float) -> Generator[Picture | None]:
        """Give the newest picture of the simulator; None after `timeout_s`."""
        with self._reader.take(timeout_s) as frame:
            if frame is None:
                yield None
                return
            header = frame.header
            epoch, sequence = self._newest
            if header.epoch == epoch and header.sequence > sequence:
                self.counts.lost += header.sequence - sequence - 1
            self._newest = (header.epoch, header.sequence)
            yield Picture(frame.layout, partial(write_pixels, frame.pixels), header.time_ns, header)

    def access_units(self) -> list[AccessUnit]:
        """Return nothing: these pictures were never encoded."""
        return []

    def want_key_frame(self) -> None:
        """Do nothing: these pictures were never encoded."""

    def close(self) -> None:
        """Do nothing: the reader belongs to the bus."""
