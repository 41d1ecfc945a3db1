"""An operator's order: repeated until it is answered, and confirmed twice where it cuts motors."""

import pytest

from fakes import FakeBus
from juncnet.messages import Ack, OverrideKind, Stamp
from juncnet.topics import COMMAND_ACK, COMMAND_OVERRIDE
from juncnet_services.cli.operator import main, order


def test_repeats_until_the_time_is_over() -> None:
    bus = FakeBus([0.1] * 40)
    ack, took_s = order(bus, OverrideKind.HOLD, "anna", 1.0)
    assert ack is None
    assert took_s == pytest.approx(1.0)
    assert len(bus.published[COMMAND_OVERRIDE.key]) in (9, 10)


def test_returns_the_answer_to_its_own_order_only() -> None:
    first, second = Stamp(epoch=1, sequence=1, time_ns=10**9, clock="fake-clock"), FakeBus().stamp()
    other = second.model_copy(update={"epoch": 0})
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
