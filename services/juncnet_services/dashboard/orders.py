"""Carries out what a page asks for, and waits for the answer of whoever is asked."""

import threading
from collections.abc import Callable

from juncnet.assets import asset_path
from juncnet.bus import Bus
from juncnet.clocks import NS_PER_S
from juncnet.messages import (
    Ack,
    LoadFollower,
    LoadModel,
    Override,
    OverrideKind,
    Reply,
    SetMission,
    Stamp,
)
from juncnet.topics import COMMAND_OVERRIDE, FOLLOWER_LOAD, MISSION_SET, MODEL_LOAD
from juncnet_services.dashboard.requests import (
    AnyAsked,
    FollowerAsked,
    MissionAsked,
    ModelAsked,
    OrderAsked,
)

REPEAT_S = 0.1
"""An order is repeated until it is answered."""
PATIENCE_S = 2.0
ANSWERS_KEPT = 64


class Orders:
    """Sends orders and requests to robots; safe in any thread. `bus_of` finds a robot's bus."""

    def __init__(self, bus_of: Callable[[str], Bus | None]) -> None:
        self._bus_of = bus_of
        self._heard = threading.Condition()
        self._acks: list[Ack] = []

    def heard(self, ack: Ack) -> None:
        """Take an answer of a vehicle's side."""
        with self._heard:
            self._acks = [*self._acks[1 - ANSWERS_KEPT :], ack]
            self._heard.notify_all()

    def carry_out(self, asked: AnyAsked) -> Reply:
        """Do what is asked for and return the answer, or a refusal that says why there is none."""
        bus = self._bus_of(asked.robot)
        if bus is None:
            return Reply(accepted=False, reason=f"no robot {asked.robot!r} was heard of")
        match asked:
            case OrderAsked():
                return self._order(bus, asked.robot, OverrideKind(asked.do))
            case MissionAsked():
                message = SetMission(mission=asked.mission)
                return bus.request(MISSION_SET, message, PATIENCE_S, asked.robot)
            case ModelAsked():
                load = LoadModel(path=model_path(asked.model))
                return bus.request(MODEL_LOAD, load, 5 * PATIENCE_S, asked.robot)
            case FollowerAsked():
                swap = LoadFollower(follower=asked.follower, options=asked.options)
                return bus.request(FOLLOWER_LOAD, swap, 5 * PATIENCE_S, asked.robot)

    def _order(self, bus: Bus, robot: str, kind: OverrideKind) -> Reply:
        started_ns = bus.clock.now_ns()
        ours: list[Stamp] = []
        while (took_s := (bus.clock.now_ns() - started_ns) / NS_PER_S) < PATIENCE_S:
            ours.append(bus.stamp())
            order = Override(issued=ours[-1], kind=kind, operator=bus.service, first_issued=ours[0])
            bus.publish(COMMAND_OVERRIDE, order, robot)
            ack = self._answer(ours)
            if ack is not None:
                took_ms = (bus.clock.now_ns() - started_ns) / 1e6
                return Reply(accepted=ack.accepted, reason=f"{ack.reason} ({took_ms:.0f} ms)")
        return Reply(
            accepted=False,
            reason=f"NO ANSWER within {took_s:.1f} s: is command_output running and linked, "
            "and may this host command?",
        )

    def _answer(self, ours: list[Stamp]) -> Ack | None:
        """Return the answer to one of our orders; None after `REPEAT_S`."""

        def found() -> Ack | None:
            return next((ack for ack in self._acks if ack.override in ours), None)

        with self._heard:
            self._heard.wait_for(lambda: found() is not None, REPEAT_S)
            return found()


def model_path(model: str) -> str:
    """Return the path of the shipped model called so; else `model` itself, a path elsewhere."""
    try:
        return str(asset_path(model, "models", ".onnx").resolve())
    except (FileNotFoundError, OSError):
        return model
