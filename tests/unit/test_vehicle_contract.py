"""A driver passes when nothing was seen that its contract forbids; each breach has its own line."""

import base64
from collections.abc import Callable
from typing import Any

import pytest

from juncnet.messages import Ack, OverrideKind, Stamp
from juncnet_services.command_output.limits import Limits
from juncnet_services.kits.vehicle_contract import Judgement, judge
from juncnet_services.kits.vehicle_trial import Part, Trial

MS = 1_000_000
HOLD = b"hold"
ORDERS = (OverrideKind.TAKE_OFF, OverrideKind.LAND, OverrideKind.EMERGENCY)
PARTS = (
    *("rest", "motion", "wild", "silence", "malformed", *map(str, ORDERS)),
    *("before killed", "killed", "before hung", "hung", "before the end"),
)
"""A second each, in this order."""
MOVING = ("motion", "wild", "before killed", "before hung", "before the end")


def call(name: str, at_ms: float, took_ms: float = 0.1, **fields: Any) -> dict[str, Any]:
    return {"call": name, "at_ns": round(at_ms * MS), "took_ns": round(took_ms * MS), **fields}


def send(at_ms: float, forward: float = 0.0, brake: bool = True) -> dict[str, Any]:
    still = {"lateral_mps": 0.0, "vertical_mps": 0.0, "yaw_rate_radps": 0.0}
    return call("send", at_ms, forward_mps=forward, brake=brake, **still)


def start_ms(part: str) -> int:
    return 1000 * PARTS.index(part)


def a_good_trial() -> Trial:
    """What is seen of a driver that does what it should, and a peer that hears it."""
    trial = Trial(exit_code=0, ended_s=0.2, arrived=[])
    packets = [base64.b64encode(HOLD).decode()]
    trial.calls = [call("open", 0), call("hold", 10, link=5, packets=packets)]
    for name in PARTS:
        begin = start_ms(name)
        last = (begin + 960) * MS if name in MOVING else 0
        trial.parts.append(Part(name, begin * MS, (begin + 999) * MS, last))
        moving = name in MOVING
        trial.calls += [send(begin + t, 1.5 * moving, not moving) for t in range(0, 1000, 40)]
    for kind in ORDERS:
        trial.calls.append(call(str(kind), start_ms(str(kind)) + 20))
        ack = Ack(override=stamp(), kind=kind, accepted=True, reason="", at=stamp())
        trial.answers[str(kind)] = ack
    for struck in ("killed", "hung"):
        holds = [(start_ms(struck) + t) * MS for t in range(100, 900, 50)]
        trial.arrived = [*(trial.arrived or []), *((at_ns, HOLD) for at_ns in holds)]
    trial.calls += [call("telemetry", 50, seen=True, flying=True)]
    trial.calls += [send(start_ms("before the end") + 999), call("close", 13_500, 20)]
    return trial


def stamp() -> Stamp:
    return Stamp(epoch=1, sequence=1, time_ns=1, clock="test")


def found(trial: Trial) -> dict[str, Judgement]:
    return {judgement.about: judgement for judgement in judge(trial, Limits())}


def test_a_driver_that_does_what_it_should_passes_every_clause() -> None:
    assert {about: j.passed for about, j in found(a_good_trial()).items() if not j.passed} == {}


def raises(trial: Trial) -> None:
    trial.calls[5]["raised"] = "OSError: no route to host"


def blocks(trial: Trial) -> None:
    trial.calls[5]["took_ns"] = 300 * MS


def creeps(trial: Trial) -> None:
    trial.calls.append(send(start_ms("rest") + 500, 0.2, brake=False))


def races(trial: Trial) -> None:
    trial.calls.append(send(start_ms("wild") + 500, 12.0, brake=False))


def never_moves(trial: Trial) -> None:
    for made in trial.calls:
        made["forward_mps"] = 0.0


def flies_on(trial: Trial) -> None:
    silent = start_ms("silence") * MS
    trial.calls = [c for c in trial.calls if not silent <= c["at_ns"] < silent + 300 * MS]


def obeys_nonsense(trial: Trial) -> None:
    trial.calls.append(send(start_ms("malformed") + 500, 1.5, brake=False))


def takes_off_twice(trial: Trial) -> None:
    trial.calls.append(call("take_off", start_ms("take_off") + 60))


def takes_off_unasked(trial: Trial) -> None:
    trial.calls.append(call("take_off", 100))


def never_lands(trial: Trial) -> None:
    trial.calls = [c for c in trial.calls if c["call"] != "land"]


def leaves_the_guard_mute(trial: Trial) -> None:
    trial.arrived = [(at, data) for at, data in trial.arrived or [] if at < start_ms("hung") * MS]


def goes_on_beside_the_guard(trial: Trial) -> None:
    trial.arrived = [*(trial.arrived or []), ((start_ms("killed") + 500) * MS, b"move")]


def ends_moving(trial: Trial) -> None:
    trial.calls.append(send(13_400, 1.0, brake=False))


def dies_at_the_end(trial: Trial) -> None:
    trial.exit_code = 1


@pytest.mark.parametrize(
    ("breach", "clause"),
    [
        (raises, "never raises"),
        (blocks, "never blocks"),
        (creeps, "rests unless told"),
        (races, "moves within limits"),
        (never_moves, "moves within limits"),
        (flies_on, "holds when silent"),
        (obeys_nonsense, "ignores malformed"),
        (takes_off_twice, "take_off"),
        (takes_off_unasked, "take_off"),
        (never_lands, "land"),
        (leaves_the_guard_mute, "holds when hung"),
        (goes_on_beside_the_guard, "holds when killed"),
        (ends_moving, "ends in order"),
        (dies_at_the_end, "ends in order"),
    ],
)
def test_a_breach_fails_its_clause(breach: Callable[[Trial], None], clause: str) -> None:
    trial = a_good_trial()
    breach(trial)
    assert found(trial)[clause].passed is False


def test_what_could_not_be_seen_is_neither_passed_nor_failed() -> None:
    trial = a_good_trial()
    trial.arrived = None
    trial.calls = [c for c in trial.calls if c["call"] not in ("telemetry", "hold")]
    unknown = {about for about, judgement in found(trial).items() if judgement.passed is None}
    assert unknown == {"telemetry", "guarded", "holds when killed", "holds when hung"}


def test_a_machine_that_is_too_busy_fails_nobody_for_times() -> None:
    trial = a_good_trial()
    blocks(trial)
    trial.late_s = 0.4
    late = found(trial)["never blocks"]
    assert late.passed is None
    assert "too busy" in late.text


def test_a_refused_take_off_is_told_with_its_reason() -> None:
    trial = a_good_trial()
    trial.calls = [c for c in trial.calls if c["call"] != "take_off"]
    refused = Ack(
        override=stamp(), kind=OverrideKind.TAKE_OFF, accepted=False, reason="no GPS", at=stamp()
    )
    trial.answers["take_off"] = refused
    take_off = found(trial)["take_off"]
    assert take_off.passed is None
    assert "no GPS" in take_off.text
