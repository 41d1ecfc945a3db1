"""Listens in on the simulated vehicle's link: every setpoint that reaches the vehicle, and when."""

import select
import socket
import threading
import time
from dataclasses import dataclass
from pathlib import Path

from juncnet.simulation.link import (
    CLIENT_MEMORY_S,
    MAX_DATAGRAM,
    LinkError,
    Setpoint,
    decode_command,
    server_address,
)

BEHIND = "vehicle-behind.sock"
POLL_S = 0.1


@dataclass(frozen=True)
class Told:
    """A setpoint as the vehicle was told it, at a time on the monotonic clock."""

    ns: int
    setpoint: Setpoint

    @property
    def holds(self) -> bool:
        """Whether the vehicle was told to hold."""
        return self.setpoint.brake


class LinkTap:
    """Takes the place of the simulator's socket and hands everything on, in both directions.

    A context. The drone and the driver of `command_output` do not notice: both keep the addresses
    that they have.
    """

    def __init__(self, flight_dir: Path) -> None:
        self._server, self._behind = server_address(flight_dir), flight_dir / BEHIND
        self._clients: dict[str, float] = {}
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self.told: list[Told] = []
        """All setpoints so far, oldest first."""

    def __enter__(self) -> "LinkTap":
        self._server.rename(self._behind)
        self._end = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._end.setblocking(False)
        self._end.bind(str(self._server))
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join()
        self._end.close()

    def _serve(self) -> None:
        while not self._ended.is_set():
            select.select([self._end], [], [], POLL_S)
            while True:
                try:
                    datagram, sender = self._end.recvfrom(MAX_DATAGRAM)
                except OSError:
                    break
                if sender == str(self._server):  # the simulator is bound to the name that we took
                    self._to_clients(datagram)
                else:
                    self._to_vehicle(datagram, sender)

    def _to_clients(self, datagram: bytes) -> None:
        now_s = time.monotonic()
        for client, heard_s in self._clients.items():
            if now_s - heard_s < CLIENT_MEMORY_S:
                self._send(datagram, client)

    def _to_vehicle(self, datagram: bytes, sender: object) -> None:
        if isinstance(sender, str):
            self._clients[sender] = time.monotonic()
        self._send(datagram, str(self._behind))
        try:
            command = decode_command(datagram)
        except LinkError:  # the simulator counts it
            return
        if isinstance(command, Setpoint):
            self.told.append(Told(time.monotonic_ns(), command))

    def _send(self, datagram: bytes, address: str) -> None:
        try:
            self._end.sendto(datagram, address)
        except OSError:
            return  # as on the link itself: who is not there, or does not read, misses it
