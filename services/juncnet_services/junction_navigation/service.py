"""junction_navigation: junction/score, road/command, vehicle/state -> command/velocity.

Also publishes junction/event and navigation/state, and answers mission/set. A count and its phase
are saved before their event is published; a restart in the same flight and mission resumes them.
"""

import logging
from threading import Lock

from pydantic import Field

from juncnet import topics
from juncnet.bus import Bus
from juncnet.clocks import Instant
from juncnet.launch import launch
from juncnet.messages import Mission, Reply, SetMission, VelocityCommand
from juncnet_services.junction_navigation.config import NavigatorConfig
from juncnet_services.junction_navigation.decision import Decision
from juncnet_services.junction_navigation.missions import load_mission
from juncnet_services.junction_navigation.navigator import Navigator
from juncnet_services.junction_navigation.pace import Pace
from juncnet_services.junction_navigation.store import Store

STEP_S = 0.05
log = logging.getLogger(__name__)


class Config(NavigatorConfig):
    """The navigator's options and its mission."""

    mission: str | Mission = Field(default="left_right")
    """A path, the name of a file in deploy/missions, or the mission itself as a table."""


def run(bus: Bus, config: Config) -> None:
    """Navigate until shutdown."""
    mission, store, lock, pace = load_mission(config.mission), Store(bus.flight_dir), Lock(), Pace()
    found = store.resume(bus.flight, mission)
    log.info("%s", found.note or found.blocked)
    navigator = Navigator(config, mission, bus.flight, found, bus.offsets)
    scores, roads = bus.subscribe(topics.JUNCTION_SCORE), bus.subscribe(topics.ROAD_COMMAND, 4)
    vehicles = bus.subscribe(topics.VEHICLE_STATE, wakes=False)

    def set_mission(request: SetMission) -> Reply:
        with lock:
            reply = navigator.set_mission(request.mission)
            store.save(navigator.progress)
        log.info("mission %s: %s", request.mission.name, reply.reason)
        return reply

    bus.serve(topics.MISSION_SET, set_mission)
    while bus.running:
        bus.wait(STEP_S)
        with lock:
            now = Instant(bus.clock.now_ns(), bus.clock.id)
            decision = navigator.step(now, scores.take(), roads.take(), vehicles.take())
            if pace.save_due(now.ns, decision):
                store.save(navigator.progress)
        publish(bus, decision, now.ns, pace)


def publish(bus: Bus, decision: Decision, taken_ns: int, pace: Pace) -> None:
    """Publish what a decision says; its events are saved by now."""
    for text in decision.refused:
        bus.health.error(text)
    for event in decision.events:
        bus.publish(topics.JUNCTION_EVENT, event)
    header, velocity = decision.header, decision.velocity
    if header is not None:
        command = VelocityCommand(header=header, issued=bus.stamp(), velocity=velocity)
        bus.publish(topics.COMMAND_VELOCITY, command)
        bus.health.output(taken_ns, header)
    if pace.state_due(taken_ns, decision):
        bus.publish(topics.NAVIGATION_STATE, decision.state)


def main() -> None:
    """Run the service as a process."""
    launch(run, Config)
