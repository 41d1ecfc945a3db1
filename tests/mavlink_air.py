"""The MAVLink driver's core and an autopilot in one simulated time, without a link."""

from typing import Any

import pytest

from autopilot import COPTER, ROVER, STRICT, Autopilot
from juncnet.messages import Velocity
from juncnet_services.command_output.vehicles.mavlink_flight import Flight, MavlinkCore, Phase
from juncnet_services.command_output.vehicles.pacing import Aim, Wish

HOLD = Wish()
STEP_S = 0.01


def go(**velocity: float) -> Wish:
    return Wish(Aim.FLY, Velocity(**velocity), False, 2**62)


class Air:
    """A core and an autopilot in one time: the driver sends at 20 Hz, the autopilot at 25."""

    def __init__(self, autopilot: Autopilot, **flight: Any) -> None:
        self.autopilot = autopilot
        self.core = MavlinkCore(Flight(kind=autopilot.kind, **flight))  # type: ignore[arg-type]
        self.now_s = 50.0
        self.core.connected(self.now_ns)
        self.count = 0

    @property
    def now_ns(self) -> int:
        return round(self.now_s * 1e9)

    def fly(self, seconds: float, wish: Wish = HOLD, *, linked: bool = True) -> None:
        for _ in range(round(seconds / STEP_S)):
            self.now_s += STEP_S
            self.count += 1
            self.autopilot.step(STEP_S, self.now_s)
            if self.count % 4 == 0:
                for packet in self.autopilot.told(self.now_s):
                    self.core.heard(packet, self.now_ns)
            if self.count % 5 == 0 and linked:
                self.give(self.core.due(wish, self.now_ns))

    def give(self, packets: list[bytes]) -> None:
        for packet in packets:
            for answer in self.autopilot.heard(packet, self.now_s):
                self.core.heard(answer, self.now_ns)

    def take_off(self) -> None:
        self.fly(2.0)
        assert self.core.trouble == ""
        self.core.take_off(self.now_ns)
        self.fly(10.0)
        assert self.autopilot.armed
        assert self.autopilot.offboard
        assert self.core.phase is Phase.IDLE

    def newest(self) -> Any:
        return self.autopilot.setpoints[-1][1]


def px4(kind: str = "copter", parameters: dict[str, float] | None = None) -> Air:
    return Air(Autopilot(kind, parameters or STRICT, px4=True))


def ardupilot(kind: str = "copter") -> Air:
    return Air(Autopilot(kind, COPTER if kind == "copter" else ROVER, px4=False))


ALL = [
    pytest.param(px4, "copter", id="px4-copter"),
    pytest.param(px4, "rover", id="px4-rover"),
    pytest.param(ardupilot, "copter", id="ardupilot-copter"),
    pytest.param(ardupilot, "rover", id="ardupilot-rover"),
]
