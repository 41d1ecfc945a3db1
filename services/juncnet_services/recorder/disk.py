"""Says that the disk is nearly full before it is, and ends the recording before others suffer."""

from juncnet.clocks import NS_PER_S
from juncnet.health import HealthReport
from juncnet_services.recorder.session import Room, Session

EVERY_NS = NS_PER_S
TEXTS: dict[Room, str] = {
    "low": "the disk is nearly full: free some of it, or recording will stop",
    "full": "the disk is full: recording has stopped, the file is complete",
}


class DiskWatch:
    """Looks once a second, and tells the health of the recorder."""

    def __init__(self, session: Session, health: HealthReport) -> None:
        self._session, self._health = session, health
        self._next_ns = 0
        self._room: Room = "enough"

    def has_room(self, now_ns: int) -> bool:
        """Return whether recording can go on."""
        if now_ns >= self._next_ns:
            self._next_ns = now_ns + EVERY_NS
            room = self._session.room()
            if room != self._room and room != "enough":
                self._health.error(f"{self._session.folder}: {TEXTS[room]}")
            self._room = room
            self._health.set("messages", self._session.messages)
            self._health.set("megabytes", self._session.size / 1e6)
        return self._room != "full"
