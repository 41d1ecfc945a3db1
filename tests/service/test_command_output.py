"""command_output with a fake bus: what it tells the vehicle, and what it answers."""

import json
import socket
from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

from fakes import FakeBus, ScriptItem
from juncnet.messages import (
    Capabilities,
    Output,
    Override,
    OverrideKind,
    Stamp,
    Velocity,
    VelocityCommand,
)
from juncnet.topics import COMMAND_ACK, COMMAND_OVERRIDE, COMMAND_VELOCITY, VEHICLE_STATE
from juncnet_services.command_output.latch import LAST_ACCEPTED, LATCH
from juncnet_services.command_output.limits import Limits
from juncnet_services.command_output.service import Config, run
from juncnet_services.command_output.vehicles import DriverOptions, Hold, Telemetry, open_vehicle

TICK = 0.01


class KeptOptions(DriverOptions):
    """This vehicle has no options."""


class KeptVehicle:
    """A driver from outside of the package, that keeps what it is told."""

    Options = KeptOptions
    told: list[tuple[str, Velocity]]
    last: "KeptVehicle"
    next_trouble = ""

    def __init__(self, options: KeptOptions, flight_dir: Path) -> None:
        self.capabilities = Capabilities(kind="copter", turns_in_place=True)
        self.send_failures = 0
        self.trouble = KeptVehicle.next_trouble
        self.told = []
        self.closed = False
        KeptVehicle.last = self

    def send(self, velocity: Velocity, brake: bool, lasts_s: float) -> None:
        assert 0 < lasts_s <= 0.2
        self.told.append(("hold" if brake else "move", velocity))

    def take_off(self) -> None:
        self.told.append(("take_off", Velocity()))

    def land(self) -> None:
        self.told.append(("land", Velocity()))

    def emergency(self) -> None:
        self.told.append(("emergency", Velocity()))

    def hold(self) -> Hold | None:
        return None

    def telemetry(self, max_age_s: float) -> Telemetry | None:
        return Telemetry(yaw_rad=1.5, battery=0.5)

    def close(self) -> None:
        self.closed = True


class AbortingVehicle(KeptVehicle):
    """A driver that goes on with a take-off until it is told not to."""

    def abort_take_off(self) -> None:
        self.told.append(("abort", Velocity()))


CONFIG = Config(vehicle=f"{__name__}:KeptVehicle")


def go(bus: FakeBus) -> None:
    """Have the pipeline ask for 2 m/s ahead, now."""
    stamp = bus.stamp()
    velocity = Velocity(forward_mps=2.0)
    for inbox in bus._inboxes[COMMAND_VELOCITY.key]:  # pyright: ignore[reportPrivateUsage]
        inbox.put(bus.robot, VelocityCommand(header=stamp, issued=stamp, velocity=velocity))


def say(kind: OverrideKind) -> ScriptItem:
    def order(bus: FakeBus) -> None:
        for inbox in bus._inboxes[COMMAND_OVERRIDE.key]:  # pyright: ignore[reportPrivateUsage]
            inbox.put(bus.robot, Override(issued=bus.stamp(), kind=kind))

    return order


def fly(tmp_path: Path, script: list[Any], config: Config = CONFIG) -> FakeBus:
    bus = FakeBus(script, "command_output", tmp_path)
    run(bus, config)
    return bus


def flown(seconds: float) -> list[Any]:
    """Return a script in which the pipeline commands every 40 ms for so long."""
    return [go, TICK, TICK, TICK, TICK] * round(seconds / 0.04)


def outputs(bus: FakeBus) -> list[Output]:
    """Return what the vehicle was told, without repeats in a row."""
    states = [state.output for state in bus.published[VEHICLE_STATE.key]]
    return [o for i, o in enumerate(states) if i == 0 or o is not states[i - 1]]


def test_flies_holds_when_the_pipeline_is_silent_and_flies_on(tmp_path: Path) -> None:
    bus = fly(tmp_path, [TICK, *flown(1.2), *[TICK] * 40, *flown(0.4)])
    expected = [Output.HOLD, Output.PIPELINE, Output.HOLD, Output.PIPELINE]
    assert outputs(bus) == expected
    assert max(v.forward_mps for _, v in KeptVehicle.last.told) == pytest.approx(2.0)
    assert bus.health.errors == []


def test_setpoints_and_state_are_steady_while_holding(tmp_path: Path) -> None:
    bus = fly(tmp_path, [TICK] * 100)
    assert len(KeptVehicle.last.told) == pytest.approx(25, abs=2)
    assert len(bus.published[VEHICLE_STATE.key]) == pytest.approx(25, abs=2)
    assert {what for what, _ in KeptVehicle.last.told} == {"hold"}


def test_state_is_no_faster_for_faster_commands(tmp_path: Path) -> None:
    bus = fly(tmp_path, [go, TICK] * 100)
    assert len(KeptVehicle.last.told) >= 100
    assert len(bus.published[VEHICLE_STATE.key]) == pytest.approx(25, abs=2)


def test_state_says_what_is_measured_and_what_is_commanded(tmp_path: Path) -> None:
    bus = fly(tmp_path, flown(0.8))
    state = bus.published[VEHICLE_STATE.key][-1]
    assert (state.yaw_rad, state.battery, state.velocity) == (1.5, 0.5, None)
    assert state.commanded.forward_mps > 1.0


def test_stop_is_latched_on_disk_when_it_is_acknowledged_and_after_a_restart(
    tmp_path: Path,
) -> None:
    bus = fly(tmp_path, [*flown(0.4), say(OverrideKind.HOLD), TICK, *flown(0.4)])
    assert outputs(bus)[-1] is Output.STOPPED
    ack = bus.published[COMMAND_ACK.key][0]
    assert ack.accepted
    assert (tmp_path / LATCH).exists()
    bus = fly(tmp_path, flown(0.4))
    assert outputs(bus) == [Output.STOPPED]
    bus = fly(tmp_path, [say(OverrideKind.RESUME), TICK, *flown(0.4)])
    assert outputs(bus)[-1] is Output.PIPELINE
    assert not (tmp_path / LATCH).exists()


def test_a_directory_that_cannot_be_written_ends_neither_flight_nor_stop(tmp_path: Path) -> None:
    (tmp_path / f"{LAST_ACCEPTED}.new").mkdir()
    bus = fly(tmp_path, [*flown(0.8), say(OverrideKind.HOLD), TICK, *flown(0.4)])
    assert outputs(bus) == [Output.PIPELINE, Output.STOPPED]
    assert "could not be written" in bus.health.errors[0]
    assert bus.published[COMMAND_ACK.key][0].accepted
    assert (tmp_path / LATCH).exists()


def test_an_unreadable_latch_is_a_stop_that_a_resume_ends(tmp_path: Path) -> None:
    (tmp_path / LATCH).write_text("{")
    assert outputs(fly(tmp_path, flown(0.4))) == [Output.STOPPED]
    bus = fly(tmp_path, [say(OverrideKind.RESUME), TICK, *flown(0.4)])
    assert outputs(bus)[-1] is Output.PIPELINE
    assert not (tmp_path / LATCH).exists()


def test_land_and_emergency_are_the_drivers_own_calls(tmp_path: Path) -> None:
    fly(tmp_path, [TICK, say(OverrideKind.LAND), TICK, TICK])
    assert "land" in {what for what, _ in KeptVehicle.last.told}
    fly(tmp_path, [TICK, say(OverrideKind.EMERGENCY), TICK, TICK])
    assert "emergency" in {what for what, _ in KeptVehicle.last.told}


def test_a_take_off_is_told_once_and_leaves_the_vehicle_stopped(tmp_path: Path) -> None:
    bus = fly(tmp_path, [TICK, say(OverrideKind.TAKE_OFF), TICK, *[TICK] * 600, *flown(0.4)])
    assert outputs(bus) == [Output.HOLD, Output.TAKING_OFF, Output.STOPPED]
    assert [what for what, _ in KeptVehicle.last.told].count("take_off") == 1
    assert bus.published[COMMAND_ACK.key][0].accepted
    bus = fly(tmp_path, [TICK] * 10)
    assert outputs(bus) == [Output.STOPPED]
    assert "take_off" not in {what for what, _ in KeptVehicle.last.told}


TAKE_OFF, STOP, RESUME = map(say, (OverrideKind.TAKE_OFF, OverrideKind.HOLD, OverrideKind.RESUME))


def steps(tmp_path: Path, *script: Any) -> list[str]:
    """Return take-offs, aborts and landings, without the setpoints between them."""
    fly(tmp_path, [TICK, *script], Config(vehicle=f"{__name__}:AbortingVehicle"))
    told = [what for what, _ in KeptVehicle.last.told if what not in ("hold", "move")]
    return [what for i, what in enumerate(told) if i == 0 or what != told[i - 1]]


def ticks(seconds: float) -> list[float]:
    return [TICK] * round(seconds / TICK)


def test_a_stop_aborts_a_take_off_once_and_before_its_hold(tmp_path: Path) -> None:
    script = [TAKE_OFF, *ticks(0.2), STOP, *ticks(0.2), STOP, *ticks(6)]
    assert steps(tmp_path, *script) == ["take_off", "abort"]
    told = [what for what, _ in KeptVehicle.last.told]
    assert told.count("abort") == 1
    assert told[told.index("abort") + 1] == "hold"


def test_a_take_off_that_is_merely_the_output_no_more_is_finished(tmp_path: Path) -> None:
    assert steps(tmp_path, TAKE_OFF, *ticks(20)) == ["take_off"]


@pytest.mark.parametrize("before_s", [4.9, 5.1, 8.0])
def test_a_climb_that_goes_on_longer_is_stopped_too(tmp_path: Path, before_s: float) -> None:
    assert steps(tmp_path, TAKE_OFF, *ticks(before_s), STOP, *ticks(0.2)) == ["take_off", "abort"]


def test_a_resume_lets_the_climb_go_on_and_a_stop_after_it_does_not(tmp_path: Path) -> None:
    script = [TAKE_OFF, *ticks(1), RESUME, TICK, *flown(2)]
    assert steps(tmp_path, *script) == ["take_off"]
    script = [RESUME, TICK, *script, STOP, *ticks(0.2)]
    assert steps(tmp_path, *script) == ["take_off", "abort"]


def test_a_stop_of_a_take_off_that_was_ordered_twice_wins(tmp_path: Path) -> None:
    script = [TAKE_OFF, *ticks(4), TAKE_OFF, *ticks(2), STOP, *ticks(0.2)]
    assert steps(tmp_path, *script) == ["take_off", "abort"]


def test_a_take_off_that_was_ordered_twice_is_finished(tmp_path: Path) -> None:
    assert steps(tmp_path, TAKE_OFF, *ticks(4), TAKE_OFF, *ticks(8)) == ["take_off"]


def test_a_landing_is_the_drivers_own_end_of_a_take_off(tmp_path: Path) -> None:
    script = [TAKE_OFF, *ticks(1), say(OverrideKind.LAND), *ticks(1), STOP, *ticks(0.2)]
    assert steps(tmp_path, *script) == ["take_off", "land"]


def test_a_vehicle_that_cannot_abort_is_held_by_a_stop_all_the_same(tmp_path: Path) -> None:
    bus = fly(tmp_path, [TICK, TAKE_OFF, *ticks(0.2), STOP, *ticks(0.2)])
    assert outputs(bus) == [Output.HOLD, Output.TAKING_OFF, Output.STOPPED]
    assert bus.published[COMMAND_ACK.key][-1].accepted
    assert KeptVehicle.last.told[-1] == ("hold", Velocity())


def test_a_vehicle_in_trouble_refuses_to_take_off_and_says_why(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(KeptVehicle, "next_trouble", "set COM_OBL_RC_ACT to 5")
    bus = fly(tmp_path, [TICK, say(OverrideKind.TAKE_OFF), TICK, TICK])
    ack = bus.published[COMMAND_ACK.key][0]
    assert not ack.accepted
    assert "set COM_OBL_RC_ACT to 5" in ack.reason
    assert "take_off" not in {what for what, _ in KeptVehicle.last.told}
    assert "COM_OBL_RC_ACT" in bus.published[VEHICLE_STATE.key][-1].output_reason


def test_refused_commands_are_counted_by_reason(tmp_path: Path) -> None:
    old = Stamp(epoch=1, sequence=10_000, time_ns=1, clock="fake-clock")
    stale = VelocityCommand(header=old, issued=old, velocity=Velocity(forward_mps=1))
    bus = fly(tmp_path, [(COMMAND_VELOCITY, stale), TICK])
    assert bus.health.counters["refused_command_stale"] == 1
    assert len(bus.health.errors) == 1
    assert outputs(bus) == [Output.HOLD]


def test_ends_in_a_hold_and_closes_the_vehicle(tmp_path: Path) -> None:
    fly(tmp_path, flown(0.4))
    assert KeptVehicle.last.told[-1][0] == "hold"
    assert KeptVehicle.last.closed


def test_limits_are_configured(tmp_path: Path) -> None:
    slow = CONFIG.model_copy(update={"limits": Limits(forward_mps=0.5)})
    fly(tmp_path, flown(0.8), slow)
    assert max(v.forward_mps for _, v in KeptVehicle.last.told) == pytest.approx(0.5)


def test_the_simulated_vehicle_speaks_and_listens(tmp_path: Path) -> None:
    simulator = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    simulator.settimeout(5)
    simulator.bind(str(tmp_path / "vehicle.sock"))
    heard: list[dict[str, Any]] = []

    def answer(bus: FakeBus) -> None:
        data, address = simulator.recvfrom(4096)
        heard.append(json.loads(data))
        measured = {"x_m": 1, "y_m": 2, "z_m": 3, "yaw_rad": 0.5, "forward_mps": 1.0}
        rest = {"lateral_mps": 0, "yaw_rate_radps": 0, "flying": True, "battery": 0.9}
        told = {"type": "telemetry", "time_ns": 5, **measured, **rest}
        simulator.sendto(json.dumps(told).encode(), address)

    script = [*flown(0.04), answer, answer, *flown(0.12)]
    bus = fly(tmp_path, script, Config(options={"kind": "rover"}))
    while True:
        heard.append(json.loads(simulator.recv(4096)))
        if heard[-1].get("brake"):
            break
    simulator.close()
    state = bus.published[VEHICLE_STATE.key][-1]
    assert state.capabilities.kind == "rover"
    assert (state.yaw_rad, state.pose.y_m, state.battery) == (0.5, 2.0, 0.9)
    assert [item["type"] for item in heard[:2]] == ["hello", "setpoint"]
    assert list(tmp_path.glob("vehicle-client-*")) == []


def test_a_simulator_that_is_away_is_survived_and_counted(tmp_path: Path) -> None:
    bus = fly(tmp_path, flown(0.4), Config())
    assert bus.health.counters["send_failures"] >= 10
    assert bus.published[VEHICLE_STATE.key][-1].pose is None


def test_the_log_vehicle_needs_nothing(tmp_path: Path) -> None:
    bus = fly(tmp_path, flown(0.4), Config(vehicle="log"))
    assert outputs(bus) == [Output.PIPELINE]


@pytest.mark.parametrize("name", ["nonsense", "no.such.module:Class", f"{__name__}:NoClass"])
def test_a_driver_that_does_not_exist_is_an_error_that_names_it(tmp_path: Path, name: str) -> None:
    with pytest.raises(ValueError, match=name):
        open_vehicle(name, {}, tmp_path)


def test_a_mistyped_driver_option_is_an_error_that_names_it(tmp_path: Path) -> None:
    with pytest.raises(ValidationError, match="telemetri"):
        open_vehicle("simulated", {"telemetri": False}, tmp_path)
