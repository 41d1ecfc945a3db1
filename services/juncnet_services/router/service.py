"""router: TCP clients -> the flight, and back.

Outsiders dial the endpoint that stands in `router.endpoint` in the flight directory. The processes
of the flight do not need it: they talk to each other directly.
"""

import logging
import socket

from pydantic import BaseModel, ConfigDict, Field

from juncnet.bus import Bus
from juncnet.flight import read_flight
from juncnet.launch import launch, open_gateway


class Config(BaseModel):
    """Where outsiders are let in."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    host: str = "127.0.0.1"
    """Address to listen on; the default keeps other hosts out."""
    port: int = Field(0, ge=0, le=65535)
    """TCP port; 0: any free one, kept through restarts within a flight."""


def run(bus: Bus, config: Config) -> None:
    """Keep the gateway open until the process shall end."""
    note = bus.flight_dir / "router.endpoint"
    address = f"{config.host}:{config.port}"
    if config.port == 0:
        address = note.read_text().strip() if note.exists() else _free_address(config.host)
    with open_gateway(read_flight(bus.flight_dir), f"tcp/{address}"):
        note.write_text(address + "\n")
        logging.getLogger(bus.service).info("outsiders are let in on tcp/%s", address)
        while bus.running:
            bus.wait(1.0)


def _free_address(host: str) -> str:
    with socket.socket() as probe:
        probe.bind((host, 0))
        return f"{host}:{probe.getsockname()[1]}"


def main() -> None:
    """Run this service."""
    launch(run, Config)
