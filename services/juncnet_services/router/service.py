"""router: TCP or TLS clients -> the flight, and back.

Outsiders dial the endpoint that stands in `router.endpoint` in the flight directory. The processes
of the flight do not need it: they talk to each other directly. With certificates every link is
mutual TLS and may do what its role may; without, the router listens on this host only, unless it is
told in so many words to let anyone fly the robot.
"""

import logging
import socket
from pathlib import Path
from typing import Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from juncnet import links
from juncnet.bus import Bus
from juncnet.flight import read_flight
from juncnet.identity import read_identity
from juncnet.launch import launch, open_gateway


class Config(BaseModel):
    """Where outsiders are let in."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    host: str = "127.0.0.1"
    """Address to listen on; the default keeps other hosts out."""
    port: int = Field(0, ge=0, le=65535)
    """TCP port; 0: any free one, kept through restarts within a flight."""
    video_port: int | None = Field(default=None, ge=1, le=65535)
    """Second port, for the video links of other hosts, so that pictures never delay commands."""
    certificates: Path | None = None
    """Folder of the role `drone`, made by deploy/certificates; best given in [links]."""
    allow_anyone_on_the_network_to_fly_this_robot: bool = False
    """Listen beyond this host without certificates; best given in [links]."""

    @model_validator(mode="after")
    def _not_open_by_accident(self) -> Self:
        trusted = self.certificates is not None or links.is_loopback(self.host)
        if not (trusted or self.allow_anyone_on_the_network_to_fly_this_robot):
            raise ValueError(
                f"host {self.host} lets other hosts in, without certificates: whoever reaches it"
                " could fly the robot. Make certificates with deploy/certificates and name them in"
                " [links] certificates, or listen on 127.0.0.1"
            )
        return self


def run(bus: Bus, config: Config) -> None:
    """Keep the gateway open until the process shall end."""
    note = bus.flight_dir / "router.endpoint"
    address = f"{config.host}:{config.port}"
    if config.port == 0:
        address = note.read_text().strip() if note.exists() else _free_address(config.host)
    identity = None if config.certificates is None else read_identity(config.certificates)
    endpoint = links.endpoint(address, identity)
    beside = config.video_port and f"{config.host}:{config.video_port}"
    video = links.endpoint(beside, identity) if beside else None
    with open_gateway(read_flight(bus.flight_dir), endpoint, identity, video):
        note.write_text((address if identity is None else endpoint) + "\n")
        log = logging.getLogger(bus.service)
        log.info("outsiders are let in on %s", endpoint)
        if not links.is_loopback(config.host) and identity is None:
            log.warning("ANYONE ON THE NETWORK CAN FLY THIS ROBOT: there are no certificates")
        while bus.running:
            bus.wait(1.0)


def _free_address(host: str) -> str:
    with socket.socket() as probe:
        probe.bind((host, 0))
        return f"{host}:{probe.getsockname()[1]}"


def main() -> None:
    """Run this service."""
    launch(run, Config)
