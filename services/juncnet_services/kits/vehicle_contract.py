"""What a vehicle's driver must do, judged by what was seen of it in a trial: pure."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from juncnet.clocks import NS_PER_S
from juncnet.messages import OverrideKind
from juncnet_services.command_output.limits import Limits
from juncnet_services.kits.vehicle_trial import Part, Trial, hold_packets

HOLD_S = 0.2
"""From the last accepted command to the first hold."""
CALL_S = 0.02
"""Longest that a call may take: the next setpoint is due 40 ms after the last."""
CLOSE_S = 3.0
BUSY_S = 0.05
"""A trial that was itself late by more judges no times."""
AXES = ("forward_mps", "lateral_mps", "vertical_mps", "yaw_rate_radps")
ROUNDING = 1e-6


@dataclass(frozen=True)
class Judgement:
    """One line of the table; `passed` None: it could not be seen, and the text says why."""

    about: str
    passed: bool | None
    text: str


def judge(trial: Trial, limits: Limits) -> list[Judgement]:
    """Return a judgement of every clause; `limits`: those that command_output was given."""
    return [
        _raises(trial),
        _blocks(trial),
        _rests(trial),
        _moves(trial, limits),
        _silence(trial),
        _malformed(trial),
        *_orders(trial),
        _telemetry(trial),
        _guardable(trial),
        _struck(trial, "killed"),
        _struck(trial, "hung"),
        _ends(trial),
    ]


def _raises(trial: Trial) -> Judgement:
    raised = [call for call in trial.calls if "raised" in call]
    text = f"{raised[0]['call']}: {raised[0]['raised']}" if raised else f"{len(trial.calls)} calls"
    return Judgement("never raises", not raised, text)


def _blocks(trial: Trial) -> Judgement:
    calls = [call for call in trial.calls if call["call"] not in ("open", "close")]
    slowest = max(calls, key=lambda call: call["took_ns"])
    took_s = slowest["took_ns"] / NS_PER_S
    text = f"longest call: {slowest['call']}, {took_s * 1e3:.1f} ms (at most {CALL_S * 1e3:.0f})"
    return _timed(trial, "never blocks", took_s <= CALL_S, text)


def _rests(trial: Trial) -> Judgement:
    told = _told(trial, trial.part("rest"))
    moved = [call for call in told if not _is_hold(call)]
    text = f"{len(told)} holds before the first command" if not moved else f"{moved[0]}"
    return Judgement("rests unless told", bool(told) and not moved, text)


def _moves(trial: Trial, limits: Limits) -> Judgement:
    """Judge that it was moved, within limits: what reaches a driver is limited already."""
    told = [*_told(trial, trial.part("motion")), *_told(trial, trial.part("wild"))]
    most = {axis: max((abs(call[axis]) for call in told), default=0.0) for axis in AXES}
    within = all(most[axis] <= getattr(limits, axis) + ROUNDING for axis in AXES)
    text = ", ".join(f"{axis} {most[axis]:.1f}" for axis in AXES)
    return Judgement("moves within limits", within and most["forward_mps"] > 0, f"at most {text}")


def _silence(trial: Trial) -> Judgement:
    return _held(trial, "holds when silent", trial.part("wild").last_ns, _calls_hold_ns(trial))


def _malformed(trial: Trial) -> Judgement:
    part = trial.part("malformed")
    moved = [call for call in _told(trial, part) if not call["brake"]]
    text = f"moved by malformed or old commands: {len(moved)} times"
    return Judgement("ignores malformed", not moved, text)


def _orders(trial: Trial) -> Iterator[Judgement]:
    for kind in (OverrideKind.TAKE_OFF, OverrideKind.LAND, OverrideKind.EMERGENCY):
        ack, part = trial.answers.get(str(kind)), trial.part(str(kind))
        within = [call for call in _named(trial, str(kind)) if _in(part, call)]
        outside = [call for call in _named(trial, str(kind)) if call not in within]
        if ack is None:
            yield Judgement(f"{kind}", False, "no answer to the order")
        elif not ack.accepted:
            yield Judgement(f"{kind}", None if not outside else False, f"refused: {ack.reason}")
        else:
            text = f"called {len(within)} times for the order, {len(outside)} times without"
            once = len(within) == 1 if kind is OverrideKind.TAKE_OFF else bool(within)
            yield Judgement(f"{kind}", once and not outside, text)


def _telemetry(trial: Trial) -> Judgement:
    asked = _named(trial, "telemetry")
    seen = [call for call in asked if call.get("seen")]
    text = f"measured in {len(seen)} of {len(asked)} calls"
    return Judgement("telemetry", True if seen else None, text)


def _guardable(trial: Trial) -> Judgement:
    links = {call["link"] for call in _named(trial, "hold") if "link" in call}
    packets = hold_packets(trial.calls)
    if not packets:
        return Judgement(
            "guarded", None, "hold() gave nothing: when command_output dies nobody holds"
        )
    text = f"{len(packets)} hold packets of at most {max(map(len, packets))} bytes"
    return Judgement("guarded", all(packets) and bool(links), text)


def _struck(trial: Trial, name: str) -> Judgement:
    about = f"holds when {name}"
    if trial.arrived is None:
        return Judgement(
            about, None, "not seen: --peer OPTION puts the check in the vehicle's place"
        )
    packets = hold_packets(trial.calls)
    holds = [at_ns for at_ns, data in trial.arrived if data in packets]
    before, struck = trial.part(f"before {name}"), trial.part(name)
    judged = _held(trial, about, before.last_ns, holds)
    late_ns = before.last_ns + int(HOLD_S * NS_PER_S)
    moved = [
        at_ns
        for at_ns, data in trial.arrived
        if late_ns < at_ns < struck.end_ns and data not in packets
    ]
    if moved and judged.passed:
        return Judgement(about, False, f"{len(moved)} packets that are no hold after the hold")
    return judged


def _ends(trial: Trial) -> Judgement:
    sent, closed = _named(trial, "send"), _named(trial, "close")
    if trial.exit_code != 0 or not closed:
        return Judgement("ends in order", False, f"exit code {trial.exit_code}")
    took_s = closed[-1]["took_ns"] / NS_PER_S
    text = f"last setpoint {'a hold' if sent[-1]['brake'] else 'no hold'}, closed in {took_s:.2f} s"
    return Judgement("ends in order", sent[-1]["brake"] and took_s <= CLOSE_S, text)


def _held(trial: Trial, about: str, last_ns: int, holds_ns: list[int]) -> Judgement:
    after = [at_ns for at_ns in holds_ns if at_ns > last_ns]
    if not after:
        return Judgement(about, False, "no hold")
    seconds = (min(after) - last_ns) / NS_PER_S
    text = f"first hold after {seconds:.2f} s (at most {HOLD_S})"
    return _timed(trial, about, seconds <= HOLD_S, text)


def _timed(trial: Trial, about: str, passed: bool, text: str) -> Judgement:
    """Return a judgement of times; none where they fail on a machine that is too busy."""
    if not passed and trial.late_s > BUSY_S:
        busy = f"; this machine is too busy to judge: late by {trial.late_s * 1e3:.0f} ms itself"
        return Judgement(about, None, text + busy)
    return Judgement(about, passed, text)


def _calls_hold_ns(trial: Trial) -> list[int]:
    """Return when the driver was told to hold, at the end of each call."""
    return [call["at_ns"] + call["took_ns"] for call in _named(trial, "send") if call["brake"]]


def _named(trial: Trial, name: str) -> list[dict[str, Any]]:
    return [call for call in trial.calls if call["call"] == name]


def _told(trial: Trial, part: Part) -> list[dict[str, Any]]:
    return [call for call in _named(trial, "send") if _in(part, call)]


def _in(part: Part, call: dict[str, Any]) -> bool:
    return part.start_ns <= call["at_ns"] <= part.end_ns


def _is_hold(call: dict[str, Any]) -> bool:
    return bool(call["brake"]) and all(call[axis] == 0 for axis in AXES)
