"""An operator's order: repeated until it is answered, and confirmed twice where it cuts motors."""

import os
import pty
import termios
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fakes import FakeBus
from juncnet.messages import Ack, Message, Override, OverrideKind, Stamp, Velocity
from juncnet.topics import COMMAND_ACK, COMMAND_OVERRIDE, Topic
from juncnet_services.cli.manual import fly, raw_terminal
from juncnet_services.cli.manual import main as manual_main
from juncnet_services.cli.operator import main, operator_name, order, verdict
from juncnet_services.cli.stick import AXES, HELD_NS, Speeds, Stick, key_names
from juncnet_services.command_output.arbiter import AGE_UNKNOWN


def test_repeats_until_the_time_is_over() -> None:
    bus = FakeBus([0.1] * 40)
    ack, took_s = order(bus, OverrideKind.HOLD, "anna", 1.0)
    assert ack is None
    assert took_s == pytest.approx(1.0)
    assert len(bus.published[COMMAND_OVERRIDE.key]) in (9, 10)


def test_returns_the_answer_to_its_own_order_only() -> None:
    first, second = Stamp(epoch=1, sequence=1, time_ns=10**9, clock="fake-clock"), FakeBus().stamp()
    other = replace(second, epoch=0)
    own, foreign = (
        Ack(override=stamp, kind=OverrideKind.HOLD, accepted=True, at=second)
        for stamp in (first, other)
    )
    bus = FakeBus([0.01, (COMMAND_ACK, foreign), 0.02, (COMMAND_ACK, own), 1.0])
    ack, took_s = order(bus, OverrideKind.HOLD, "anna", 1.0)
    assert ack == own
    assert took_s == pytest.approx(0.03)


@pytest.mark.parametrize("answers", [["no"], ["EMERGENCY", "yes"]])
def test_an_emergency_asks_twice(answers: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    replies = iter(answers)

    def reply(question: str) -> str:
        del question
        return next(replies)

    monkeypatch.setattr("builtins.input", reply)
    assert main(["emergency", "--flight", "/nowhere"]) == 1
    assert next(replies, None) is None


def test_an_emergency_that_nobody_confirms_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    def closed(question: str) -> str:
        raise EOFError(question)

    monkeypatch.setattr("builtins.input", closed)
    assert main(["emergency", "--flight", "/nowhere"]) == 1


def test_an_orders_help_is_its_own(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["stop", "--help"])
    assert capsys.readouterr().out.startswith("usage: juncnet stop [-h]")


class Vehicle(FakeBus):
    """Answers each order with the next of `answers`: what became of it, and why."""

    def __init__(self, *answers: tuple[bool, str], seconds: float = 3.0) -> None:
        super().__init__([0.05] * round(seconds / 0.05))
        self.answers = list(answers)

    def publish(self, topic: Topic[Any], message: Message, robot: str | None = None) -> None:
        super().publish(topic, message, robot)
        if isinstance(message, Override) and self.answers:
            accepted, reason = self.answers.pop(0)
            ack = Ack(
                override=message.issued,
                kind=message.kind,
                accepted=accepted,
                reason=reason,
                at=self.stamp(),
            )
            for inbox in self._inboxes[COMMAND_ACK.key]:
                inbox.put(self.robot, ack)


def test_goes_on_while_only_its_clock_is_not_known_yet() -> None:
    unknown = f"resume refused: {AGE_UNKNOWN}"
    ack, _ = order(
        Vehicle((False, unknown), (False, unknown), (True, "flies")),
        OverrideKind.RESUME,
        "anna",
        1.0,
    )
    assert ack is not None
    assert ack.reason == "flies"
    ack, took_s = order(Vehicle((False, unknown)), OverrideKind.RESUME, "anna", 1.0)
    assert ack is not None
    assert ack.reason == unknown
    assert took_s >= 1.0


def test_any_other_refusal_is_final() -> None:
    ack, took_s = order(
        Vehicle((False, "no take-off: battery"), (True, "")), OverrideKind.TAKE_OFF, "anna", 1.0
    )
    assert ack is not None
    assert ack.reason == "no take-off: battery"
    assert took_s < 0.1


def test_an_operator_is_called_after_user_and_host() -> None:
    user, _, host = operator_name().partition(".")
    assert user
    assert host
    Override(issued=FakeBus().stamp(), kind=OverrideKind.HOLD, operator=operator_name())


def test_a_verdict_names_the_time_or_what_may_be_wrong() -> None:
    stamp = FakeBus().stamp()
    ack = Ack(override=stamp, kind=OverrideKind.HOLD, accepted=True, reason="holding", at=stamp)
    assert verdict("stop", ack, 0.0123) == "stop: obeyed after 12 ms: holding"
    assert "REFUSED" in verdict("stop", ack.model_copy(update={"accepted": False}), 0.1)
    assert "certificate" in verdict("stop", None, 3.0)


MS = 1_000_000
SPEEDS = Speeds(forward=2.0, lateral=0.5, vertical=0.4, yaw=0.6)


def test_a_key_moves_the_robot_for_a_fifth_of_a_second() -> None:
    stick = Stick(SPEEDS)
    assert stick.velocity(0) == Velocity()
    assert stick.press("w", 1000 * MS)
    assert stick.press("left", 1100 * MS)
    assert stick.velocity(1199 * MS) == Velocity(forward_mps=2.0, yaw_rate_radps=0.6)
    assert stick.velocity(1200 * MS) == Velocity(yaw_rate_radps=0.6)
    assert stick.velocity(1300 * MS) == Velocity()
    stick.press("s", 2000 * MS)
    assert stick.velocity(2000 * MS).forward_mps == -2.0
    stick.release()
    assert stick.velocity(2000 * MS) == Velocity()
    assert not stick.press("z", 3000 * MS)


@given(st.lists(st.tuples(st.sampled_from([*AXES, "z"]), st.integers(0, 300)), max_size=20))
def test_no_key_is_no_motion_whatever_was_pressed(presses: list[tuple[str, int]]) -> None:
    stick, now_ns = Stick(SPEEDS), 0
    for key, passed_ms in presses:
        now_ns += passed_ms * MS
        stick.press(key, now_ns)
        asked = stick.velocity(now_ns)
        assert abs(asked.forward_mps) in (0.0, 2.0)
        assert abs(asked.yaw_rate_radps) in (0.0, 0.6)
    assert stick.velocity(now_ns + HELD_NS) == Velocity()


def test_keys_are_read_from_what_a_terminal_sends() -> None:
    assert key_names("w\x1b[A\x1bOD ") == ["w", "up", "left", "space"]
    assert key_names("W\x1b[Z\x03") == ["w", "leave"]
    assert key_names("\x1b") == ["leave"]


@given(st.text())
def test_whatever_a_terminal_sends_is_read(text: str) -> None:
    assert all(key_names(text))


def flown(*pressed: list[str]) -> tuple[list[Override], list[str]]:
    """Fly with these keys, one list a period; return what was sent and the last line shown."""
    script, lines = [*pressed, ["leave"]], list[str]()
    bus = Vehicle(*[(True, "manual")] * 40)

    def keys(timeout_s: float) -> list[str]:
        bus.clock.advance(timeout_s)
        return script.pop(0)

    fly(bus, keys, Stick(SPEEDS), "anna", lines.append)
    return bus.published[COMMAND_OVERRIDE.key], lines


def test_manual_flight_sends_each_period_and_zero_without_a_key() -> None:
    sent, lines = flown(["w"], [], [], [], [], [])
    assert {order.kind for order in sent} == {OverrideKind.MANUAL}
    speeds = [order.velocity.forward_mps for order in sent if order.velocity]
    assert speeds == [2.0, 2.0, 2.0, 2.0, 0.0, 0.0]
    assert "ms" in lines[-1]


def test_manual_flight_gives_orders_and_stands_still_then() -> None:
    sent, _ = flown(["w", "space"], ["g", "t", "l"])
    kinds = [order.kind for order in sent if order.kind is not OverrideKind.MANUAL]
    hold, resume, take_off, land = (
        OverrideKind.HOLD,
        OverrideKind.RESUME,
        OverrideKind.TAKE_OFF,
        OverrideKind.LAND,
    )
    assert kinds == [hold, resume, take_off, land]
    assert all(order.velocity in (None, Velocity()) for order in sent)


def test_manual_flight_says_when_nobody_answers() -> None:
    bus, lines, script = FakeBus([0.05] * 40), list[str](), [list[str]()] * 5 + [["leave"]]

    def keys(timeout_s: float) -> list[str]:
        bus.clock.advance(timeout_s)
        return script.pop(0)

    fly(bus, keys, Stick(SPEEDS), "anna", lines.append)
    assert "NO ANSWER" in lines[-1]


def test_a_terminal_is_left_as_it_was() -> None:
    ours, theirs = pty.openpty()
    before = termios.tcgetattr(theirs)
    with raw_terminal(theirs) as keys:
        assert keys(0.01) == []
        os.write(ours, b"w\x1b[C")
        assert keys(5.0) == ["w", "right"]
        assert termios.tcgetattr(theirs) != before
    assert termios.tcgetattr(theirs) == before
    os.close(ours)
    os.close(theirs)


def test_manual_flight_needs_a_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    assert manual_main([]) == 2
    assert "terminal" in capsys.readouterr().err
