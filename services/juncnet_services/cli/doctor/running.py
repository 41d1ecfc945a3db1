"""What `juncnet doctor` hears of a flight that is up: processes, links, clocks, camera, vehicle."""

from collections.abc import Iterator, Mapping

from juncnet.bus import Bus, Inbox
from juncnet.clocks import MAX_COMMAND_AGE_S, NS_PER_S
from juncnet.flight import Flight
from juncnet.messages import Health, Output, VehicleState
from juncnet.topics import VEHICLE_STATE, health_topic
from juncnet_services.cli.doctor.findings import Finding, failure, ok, warning
from juncnet_services.cli.doctor.parts import battery

LISTEN_S = 3.5
"""Health comes once a second; clocks are known within a second of being wanted."""
MOST_UNCERTAIN_S = 0.25 * MAX_COMMAND_AGE_S
"""An uncertainty is added to every age: more than this leaves commands little time."""


def listen(bus: Bus, flight: Flight) -> tuple[dict[str, Health], VehicleState | None]:
    """Return the newest health of each process and the vehicle's state, heard for `LISTEN_S`."""
    inboxes: dict[str, Inbox[Health]] = {
        name: bus.subscribe(health_topic(name)) for name in flight.processes
    }
    states = bus.subscribe(VEHICLE_STATE, wakes=False)
    until_ns = bus.clock.now_ns() + int(LISTEN_S * NS_PER_S)
    healths: dict[str, Health] = {}
    while bus.running and bus.clock.now_ns() < until_ns:
        bus.wait(0.5)
        for name, inbox in inboxes.items():
            for _, health in inbox.drain():
                healths[name] = health
        states.drain()
    return healths, states.newest


def processes(flight: Flight, healths: Mapping[str, Health]) -> Iterator[Finding]:
    """Judge which processes of the flight report, and what they complain of."""
    silent = [name for name in flight.processes if name not in healths]
    if silent:
        yield failure(
            "processes",
            f"{', '.join(silent)} did not report within {LISTEN_S:g} s",
            f"juncnet status; logs are in {flight.directory}",
        )
    else:
        yield ok("processes", f"all {len(flight.processes)} report")
    for name, health in healths.items():
        if health.linked is False:
            yield failure(
                "link",
                f"{name} does not reach the vehicle's router: {health.last_error or 'no answer'}",
                "is the vehicle in reach, its layout up, and this host's certificate of its CA?",
            )


def clocks(healths: Mapping[str, Health]) -> Iterator[Finding]:
    """Judge the offsets of other hosts' clocks: without a good one everything counts as stale."""
    for name, health in healths.items():
        for clock, offset in health.clocks.items():
            if offset.offset_ns is None or offset.uncertainty_ns is None:
                yield failure(
                    "clocks",
                    f"{name} does not know {clock}: all that comes from there counts as stale",
                    "the link is lost or too slow: see `link`",
                )
                continue
            uncertain_s = offset.uncertainty_ns / NS_PER_S
            text = (
                f"{name}: {clock[:18]} runs {offset.offset_ns / 1e6:+.1f} ms ahead,"
                f" +- {1000 * uncertain_s:.1f} ms"
            )
            if uncertain_s > MOST_UNCERTAIN_S:
                yield warning("clocks", text, "the link is slow: move closer, change the channel")
            else:
                yield ok("clocks", text)


def camera(healths: Mapping[str, Health]) -> Iterator[Finding]:
    """Judge whether pictures come."""
    health = healths.get("frame_capture")
    if health is None:
        return
    if health.rate_hz == 0:
        yield failure(
            "camera",
            f"no pictures: {health.last_error or 'nothing came'}",
            "is the camera on, and [frame_capture] source right?",
        )
    else:
        yield ok("camera", f"{health.rate_hz:.1f} pictures a second")


def vehicle(state: VehicleState | None) -> Iterator[Finding]:
    """Judge what the vehicle's side says."""
    if state is None:
        yield failure("vehicle", "no vehicle/state", "is command_output running?")
        return
    text = f"{state.output}{f': {state.output_reason}' if state.output_reason else ''}"
    if state.output in (Output.STOPPED, Output.EMERGENCY):
        yield warning("vehicle", text, "juncnet resume, once it may move")
    else:
        yield ok("vehicle", text)
    if state.battery is not None:
        yield battery(state.battery)
