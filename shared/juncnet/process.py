"""What a process knows of itself, whatever carries its messages."""

import itertools
from pathlib import Path

from juncnet.clock_offset import Offsets
from juncnet.clocks import Clock
from juncnet.flight import Flight, HostClock
from juncnet.health import HealthCounters
from juncnet.inbox import Wake
from juncnet.messages import Stamp


class ServiceProcess:
    """A process of a flight: the part of a `Bus` that needs no connection."""

    def __init__(self, flight: Flight, service: str, state_dir: Path) -> None:
        self._flight, self._service, self._state_dir = flight, service, state_dir
        self._clock: Clock = HostClock()
        self._epoch = self._clock.now_ns()
        self._sequence = itertools.count(1)
        self._offsets = Offsets(self._clock)
        self._health = HealthCounters(service, self._clock, self._offsets)
        self._wake = Wake()

    @property
    def robot(self) -> str:
        """The robot's name on the bus."""
        return self._flight.robot

    @property
    def service(self) -> str:
        """The service's name."""
        return self._service

    @property
    def flight(self) -> str:
        """Id of this start of the layout."""
        return self._flight.id

    @property
    def epoch(self) -> int:
        """Epoch of this process as a source: monotonic time of its host in ns at its start."""
        return self._epoch

    @property
    def clock(self) -> Clock:
        """The host's monotonic clock."""
        return self._clock

    @property
    def offsets(self) -> Offsets:
        """Measured offsets of other hosts' clocks; to look one up is to have it measured."""
        return self._offsets

    @property
    def health(self) -> HealthCounters:
        """What the service tells about itself."""
        return self._health

    @property
    def running(self) -> bool:
        """False once the process shall end."""
        return self._wake.running

    @property
    def flight_dir(self) -> Path:
        """Where this flight's state lives."""
        return self._flight.directory

    @property
    def state_dir(self) -> Path:
        """Where what outlives a flight lives, by robot."""
        return self._state_dir

    def stamp(self) -> Stamp:
        """Return a stamp of now with the next sequence of this process."""
        clock, sequence = self._clock.id, next(self._sequence)
        return Stamp(self._epoch, sequence, self._clock.now_ns(), clock)  # the time last

    def stop(self) -> None:
        """Make `running` False and end all waiting. Safe in a signal handler."""
        self._wake.stop()
