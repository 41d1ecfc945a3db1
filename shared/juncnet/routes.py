"""What goes over the network from a host that is not the vehicle. Pure.

A process hears a service of its own host here, and one that runs elsewhere through the vehicle's
router; what it publishes goes both ways, for Zenoh sends it over the network only while somebody
listens there. So a message is heard once, and moving a service to the other host changes nothing
but the two lists of processes.

One service may run on both hosts: `frame_capture` forwards camera/video on the vehicle, and takes
it on the laptop to decode it. Whoever listens to a topic of its own service means the other one,
and is not to send it back there.
"""


class Routes:
    """The routes of one process: `service`, on a host with these `processes`."""

    def __init__(self, processes: tuple[str, ...], service: str) -> None:
        self._processes, self._service = processes, service
        self._taken: set[str] = set()

    def is_elsewhere(self, service: str) -> bool:
        """Return whether `service` may run on another host (`*`, any, may)."""
        return service not in self._processes or service == self._service

    def hears_here(self, publisher: str) -> bool:
        """Return whether what `publisher` publishes may come from this host."""
        return publisher != self._service

    def hears_there(self, publisher: str, key: str) -> bool:
        """Return whether `key` of `publisher` is to be heard over the network, and remember it."""
        if publisher == self._service:
            self._taken.add(key)
        return self.is_elsewhere(publisher)

    def tells_there(self, key: str) -> bool:
        """Return whether what is published here under `key` may be heard over the network."""
        return key not in self._taken
