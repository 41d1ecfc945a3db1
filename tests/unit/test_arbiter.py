"""Who is obeyed, and for how long."""

import itertools

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from juncnet.clocks import MAX_COMMAND_AGE_S, Instant, Offset
from juncnet.messages import Output, Override, OverrideKind, Stamp, Velocity, VelocityCommand
from juncnet_services.command_output.arbiter import Arbiter, Latched, LatchKind, Rules

CLOCK = "here"
START_NS = 100_000_000_000
AHEAD = Velocity(forward_mps=2.0)
SEQUENCE = itertools.count(1)


def at(seconds: float, clock: str = CLOCK) -> Instant:
    return Instant(START_NS + round(seconds * 1e9), clock)


def stamp(seconds: float, sequence: int | None = None, epoch: int = 1, clock: str = CLOCK) -> Stamp:
    number = next(SEQUENCE) if sequence is None else sequence
    return Stamp(epoch=epoch, sequence=number, time_ns=at(seconds).ns, clock=clock)


def command(
    issued: float,
    captured: float | None = None,
    clock: str = CLOCK,
    sequence: int | None = None,
    epoch: int = 1,
    velocity: Velocity = AHEAD,
) -> VelocityCommand:
    picture = stamp(issued if captured is None else captured, clock=clock)
    issuance = stamp(issued, sequence, epoch, clock)
    return VelocityCommand(header=picture, issued=issuance, velocity=velocity)


def order(
    kind: OverrideKind, issued: float, sequence: int | None = None, epoch: int = 1
) -> Override:
    velocity = Velocity(forward_mps=-1.0) if kind is OverrideKind.MANUAL else None
    return Override(issued=stamp(issued, sequence, epoch), kind=kind, velocity=velocity)


def test_holds_before_the_first_command_however_long_that_takes() -> None:
    arbiter = Arbiter(Rules())
    assert arbiter.step(at(0)).output is Output.HOLD
    assert arbiter.step(at(1000)).output is Output.HOLD


def test_an_accepted_command_lives_for_its_life_and_no_longer() -> None:
    arbiter = Arbiter(Rules())
    assert arbiter.command(command(0.0), at(0.01)) is None
    assert arbiter.step(at(0.01)).velocity == AHEAD
    assert arbiter.step(at(0.159)).output is Output.PIPELINE
    assert arbiter.step(at(0.161)).output is Output.HOLD


def test_a_command_ends_with_its_own_age_and_that_of_its_picture() -> None:
    arbiter = Arbiter(Rules(picture_age_s=0.2))
    assert arbiter.command(command(issued=0.0), at(0.15)) is None
    assert arbiter.step(at(0.199)).output is Output.PIPELINE
    assert arbiter.step(at(0.201)).output is Output.HOLD
    assert arbiter.command(command(issued=1.0, captured=0.9), at(1.0)) is None
    assert arbiter.step(at(1.099)).output is Output.PIPELINE
    assert arbiter.step(at(1.101)).output is Output.HOLD


@pytest.mark.parametrize(
    ("late", "reason"),
    [
        (command(issued=0.0), "command_stale"),
        (command(issued=0.25, captured=0.0), "picture_stale"),
        (command(issued=0.25, clock="elsewhere"), "command_age_unknown"),
        (command(issued=9.0), "command_age_unknown"),
    ],
)
def test_what_is_old_or_of_unknown_age_is_refused_and_counted(
    late: VelocityCommand, reason: str
) -> None:
    arbiter = Arbiter(Rules(picture_age_s=0.2))
    assert arbiter.command(late, at(0.26)) == reason
    assert arbiter.refused == {reason: 1}
    assert arbiter.step(at(0.26)).output is Output.HOLD


def test_a_measured_offset_makes_another_clock_known() -> None:
    arbiter = Arbiter(Rules(), offsets={"elsewhere": Offset(5_000_000_000, 1_000_000)})
    assert arbiter.command(command(5.0, clock="elsewhere"), at(0.01)) is None


def test_a_wifi_layout_allows_older_pictures_not_older_commands() -> None:
    arbiter = Arbiter(Rules(picture_age_s=0.6))
    assert arbiter.command(command(issued=0.45, captured=0.0), at(0.5)) is None
    assert arbiter.command(command(issued=0.45, captured=0.4), at(0.7)) == "command_stale"


def test_replays_are_refused_and_a_restarted_sender_is_not() -> None:
    arbiter = Arbiter(Rules())
    assert arbiter.command(command(0.0, sequence=7), at(0)) is None
    assert arbiter.command(command(0.0, sequence=7), at(0)) == "command_replayed"
    assert arbiter.command(command(0.0, sequence=6), at(0)) == "command_replayed"
    assert arbiter.command(command(0.0, sequence=0, epoch=2), at(0)) is None
    assert arbiter.command(command(0.1, sequence=8, epoch=1), at(0.1)) == "command_replayed"


@pytest.mark.parametrize("kind", OverrideKind)
def test_two_terminals_of_an_operator_do_not_refuse_each_other(kind: OverrideKind) -> None:
    arbiter = Arbiter(Rules())
    arbiter.override(order(OverrideKind.HOLD, 0, sequence=900, epoch=9), at(0))
    arbiter.override(order(OverrideKind.RESUME, 0.1, sequence=901, epoch=9), at(0.1))
    assert arbiter.override(order(kind, 1, sequence=1, epoch=3), at(1)).accepted
    if kind is not OverrideKind.HOLD:
        assert not arbiter.override(order(kind, 1, sequence=1, epoch=3), at(1.1)).accepted
    again = arbiter.override(order(OverrideKind.RESUME, 0.1, sequence=901, epoch=9), at(1.2))
    assert not again.accepted


def test_a_short_loss_ends_by_itself_and_a_long_one_by_an_operator() -> None:
    arbiter = Arbiter(Rules(loss_latch_s=5.0))
    arbiter.command(command(0.0), at(0))
    arbiter.step(at(4.0))
    assert arbiter.command(command(4.9), at(4.9)) is None
    assert arbiter.step(at(4.9)).output is Output.PIPELINE
    assert arbiter.command(command(10.0), at(10.0)) is None
    stopped = arbiter.step(at(10.0))
    assert stopped.output is Output.STOPPED
    assert "operator" in stopped.reason
    assert arbiter.override(order(OverrideKind.RESUME, 11), at(11)).accepted
    arbiter.command(command(11.1), at(11.1))
    assert arbiter.step(at(11.1)).output is Output.PIPELINE


def test_a_predecessors_loss_counts() -> None:
    assert Arbiter(Rules(), last_accepted=at(0)).step(at(3)).output is Output.HOLD
    assert Arbiter(Rules(), last_accepted=at(0)).step(at(6)).output is Output.STOPPED
    assert Arbiter(Rules(), last_accepted=at(0, "old-boot")).step(at(3)).output is Output.STOPPED


def test_hold_is_obeyed_whatever_its_age_clock_or_sequence() -> None:
    for hold in (
        order(OverrideKind.HOLD, -90),
        order(OverrideKind.HOLD, 90),
        order(OverrideKind.HOLD, 0, sequence=0, epoch=0),
        Override(issued=stamp(0, clock="elsewhere"), kind=OverrideKind.HOLD),
    ):
        arbiter = Arbiter(Rules())
        arbiter.override(order(OverrideKind.RESUME, 0), at(0))
        arbiter.command(command(0.0), at(0))
        assert arbiter.override(hold, at(0)).accepted
        assert arbiter.step(at(0)).output is Output.STOPPED


def test_the_pipeline_resumes_only_with_what_comes_after_the_resume() -> None:
    arbiter = Arbiter(Rules())
    arbiter.override(order(OverrideKind.HOLD, 0), at(0))
    arbiter.command(command(0.1), at(0.1))
    arbiter.override(order(OverrideKind.RESUME, 0.11), at(0.11))
    assert arbiter.step(at(0.11)).output is Output.HOLD
    arbiter.command(command(0.12), at(0.12))
    assert arbiter.step(at(0.12)).output is Output.PIPELINE


def test_manual_wins_over_the_pipeline_and_lives_as_long() -> None:
    arbiter = Arbiter(Rules())
    arbiter.command(command(0.0), at(0))
    assert arbiter.override(order(OverrideKind.MANUAL, 0), at(0)).accepted
    assert arbiter.step(at(0)).velocity == Velocity(forward_mps=-1.0)
    assert arbiter.step(at(0.149)).output is Output.MANUAL
    assert not arbiter.step(at(0.151)).moving


def test_a_pilot_who_falls_silent_leaves_the_robot_to_nobody_until_it_is_resumed() -> None:
    arbiter = Arbiter(Rules())
    arbiter.override(order(OverrideKind.MANUAL, 0), at(0))
    for restarted in (arbiter, Arbiter(Rules(), arbiter.latched, at(0))):
        restarted.command(command(0.2), at(0.2))
        decision = restarted.step(at(0.2))
        assert decision.output is Output.STOPPED
        assert "by hand" in decision.reason
        assert restarted.override(order(OverrideKind.MANUAL, 0.3), at(0.3)).accepted
        assert restarted.step(at(0.3)).output is Output.MANUAL
        assert restarted.override(order(OverrideKind.RESUME, 0.6), at(0.6)).accepted
        restarted.command(command(0.7), at(0.7))
        assert restarted.step(at(0.7)).output is Output.PIPELINE


def test_a_stop_ends_flight_by_hand() -> None:
    arbiter = Arbiter(Rules())
    arbiter.override(order(OverrideKind.MANUAL, 0), at(0))
    arbiter.override(order(OverrideKind.HOLD, 0.05), at(0.05))
    assert not arbiter.override(order(OverrideKind.MANUAL, 0.1), at(0.1)).accepted
    assert not arbiter.step(at(0.1)).moving


@pytest.mark.parametrize("kind", [OverrideKind.RESUME, OverrideKind.TAKE_OFF])
@pytest.mark.parametrize("stop", [OverrideKind.HOLD, OverrideKind.LAND])
def test_what_was_first_given_before_a_stop_is_refused_when_repeated_after_it(
    kind: OverrideKind, stop: OverrideKind
) -> None:
    arbiter = Arbiter(Rules())
    arbiter.override(order(stop, 1.05), at(1.05))
    late = order(kind, 1.1).model_copy(update={"first_issued": stamp(1.0)})
    verdict = arbiter.override(late, at(1.1))
    assert not verdict.accepted
    assert "give it again" in verdict.reason
    assert arbiter.override(order(kind, 1.2), at(1.2)).accepted


def test_cut_motors_are_not_forgotten_before_a_resume_not_by_a_restart_either() -> None:
    arbiter = Arbiter(Rules())
    arbiter.override(order(OverrideKind.EMERGENCY, 0), at(0))
    arbiter.override(order(OverrideKind.HOLD, 0.1), at(0.1))
    for restarted in (arbiter, Arbiter(Rules(), arbiter.latched)):
        verdict = restarted.override(order(OverrideKind.TAKE_OFF, 0.2), at(0.2))
        assert not verdict.accepted
        assert "the motors are cut" in verdict.reason


def test_manual_while_stopped_is_refused_with_the_remedy() -> None:
    arbiter = Arbiter(Rules())
    arbiter.override(order(OverrideKind.HOLD, 0), at(0))
    verdict = arbiter.override(order(OverrideKind.MANUAL, 0), at(0))
    assert not verdict.accepted
    assert "resume first" in verdict.reason


@pytest.mark.parametrize("kind", [k for k in OverrideKind if k is not OverrideKind.HOLD])
def test_other_orders_are_refused_when_old_or_repeated(kind: OverrideKind) -> None:
    arbiter = Arbiter(Rules())
    assert not arbiter.override(order(kind, 0, sequence=1), at(2.1)).accepted
    assert arbiter.override(order(kind, 3, sequence=2), at(3)).accepted
    arbiter.override(order(OverrideKind.RESUME, 3, sequence=3), at(3))
    again = arbiter.override(order(kind, 3, sequence=2), at(3))
    assert not again.accepted
    assert "repeat" in again.reason


def test_landing_and_holding_replace_each_other_and_both_keep_the_pipeline_out() -> None:
    arbiter = Arbiter(Rules())
    for kind, output in (
        (OverrideKind.HOLD, Output.STOPPED),
        (OverrideKind.LAND, Output.LANDING),
        (OverrideKind.HOLD, Output.STOPPED),
    ):
        arbiter.override(order(kind, 0), at(0))
        arbiter.command(command(0.0), at(0))
        assert arbiter.step(at(0)).output is output


def test_an_emergency_wins_over_all_and_is_a_stop_after_a_restart() -> None:
    arbiter = Arbiter(Rules())
    arbiter.override(order(OverrideKind.EMERGENCY, 0), at(0))
    arbiter.override(order(OverrideKind.HOLD, 0), at(0))
    assert arbiter.step(at(0)).output is Output.EMERGENCY
    assert Arbiter(Rules(), latched=arbiter.latched).step(at(1)).output is Output.STOPPED


Steps = list[tuple[str, float, float, int]]


@settings(max_examples=150, deadline=None)
@given(
    st.lists(
        st.tuples(
            st.sampled_from(["command", *OverrideKind]),
            st.floats(0, 1.5),
            st.floats(-0.3, 3),
            st.integers(0, 12),
        ),
        max_size=40,
    )
)
def test_nothing_old_repeated_or_stopped_is_ever_obeyed(steps: Steps) -> None:
    arbiter, now_s, stopped = Arbiter(Rules()), 0.0, False
    seen: set[int] = set()
    accepted: tuple[float, float] | None = None
    for what, passed_s, age, sequence in steps:
        now_s += passed_s
        if what == "command":
            sent = command(now_s - age, sequence=sequence)
            if arbiter.command(sent, at(now_s)) is None:
                assert -1e-6 <= age <= MAX_COMMAND_AGE_S + 1e-6
                assert sequence > max(seen, default=-1)
                seen.add(sequence)
                accepted = (now_s, now_s - age)
        else:
            kind = OverrideKind(what)
            verdict = arbiter.override(order(kind, now_s - age), at(now_s))
            if verdict.accepted and kind is OverrideKind.RESUME:
                stopped = False
            elif verdict.accepted and kind is not OverrideKind.MANUAL:
                stopped = True
        decision = arbiter.step(at(now_s))
        by_hand = arbiter.latched is not None and arbiter.latched.kind is LatchKind.MANUAL
        free = arbiter.latched is None or (by_hand and decision.output is Output.MANUAL)
        assert not (decision.moving and (stopped or not free))
        if decision.output is Output.PIPELINE:
            assert accepted is not None
            assert now_s - accepted[0] <= 0.15 + 1e-6
            assert now_s - accepted[1] <= MAX_COMMAND_AGE_S + 1e-6


@given(st.sampled_from(LatchKind), st.floats(0, 100))
def test_a_latch_found_on_disk_stops_until_resumed(kind: LatchKind, now_s: float) -> None:
    arbiter = Arbiter(Rules(), latched=Latched(kind=kind, reason="found"))
    arbiter.command(command(now_s), at(now_s))
    assert not arbiter.step(at(now_s)).moving
    arbiter.override(order(OverrideKind.RESUME, now_s), at(now_s))
    arbiter.command(command(now_s), at(now_s))
    assert arbiter.step(at(now_s)).moving


def test_no_motion_is_a_hold_whoever_asks_for_it() -> None:
    """So a rover brakes by its braking limit when the navigator misses its inputs."""
    arbiter = Arbiter(Rules())
    arbiter.command(command(0.0), at(0))
    assert arbiter.step(at(0)).moving
    arbiter.command(command(0.1, velocity=Velocity()), at(0.1))
    decision = arbiter.step(at(0.1))
    assert decision.output is Output.PIPELINE
    assert not decision.moving
    arbiter.command(command(0.2, velocity=Velocity(yaw_rate_radps=0.3)), at(0.2))
    assert arbiter.step(at(0.2)).moving


def test_a_take_off_needs_rest_and_ends_stopped_in_the_air() -> None:
    arbiter = Arbiter(Rules())
    arbiter.command(command(0.0), at(0))
    refused = arbiter.override(order(OverrideKind.TAKE_OFF, 0), at(0))
    assert not refused.accepted
    assert "stop it first" in refused.reason
    assert arbiter.override(order(OverrideKind.TAKE_OFF, 1), at(1)).accepted
    arbiter.command(command(1.1), at(1.1))
    assert arbiter.step(at(1.1)).output is Output.TAKING_OFF
    assert arbiter.step(at(6.1)).output is Output.STOPPED
    arbiter.override(order(OverrideKind.RESUME, 6.2), at(6.2))
    arbiter.command(command(6.3), at(6.3))
    assert arbiter.step(at(6.3)).output is Output.PIPELINE


def test_a_take_off_that_is_ordered_again_while_it_lasts_changes_nothing() -> None:
    arbiter = Arbiter(Rules())
    arbiter.override(order(OverrideKind.TAKE_OFF, 0), at(0))
    before = arbiter.latched
    again = arbiter.override(order(OverrideKind.TAKE_OFF, 4), at(4), "no GPS")
    assert again.accepted
    assert "already" in again.reason
    assert arbiter.latched == before
    assert arbiter.step(at(4.9)).output is Output.TAKING_OFF
    assert arbiter.step(at(5.1)).output is Output.STOPPED


def test_a_resume_that_was_first_given_before_a_take_off_does_not_end_its_stop() -> None:
    arbiter = Arbiter(Rules())
    arbiter.override(order(OverrideKind.TAKE_OFF, 1), at(1))
    late = order(OverrideKind.RESUME, 1.1).model_copy(update={"first_issued": stamp(0.9)})
    assert not arbiter.override(late, at(1.1)).accepted
    assert arbiter.step(at(1.1)).output is Output.TAKING_OFF


@pytest.mark.parametrize("kind", [OverrideKind.HOLD, OverrideKind.LAND, OverrideKind.EMERGENCY])
def test_a_restart_remembers_when_it_was_stopped(kind: OverrideKind) -> None:
    before = Arbiter(Rules())
    before.override(order(OverrideKind.EMERGENCY, 0.5), at(0.5))
    before.override(order(kind, 1), at(1))
    arbiter = Arbiter(Rules(), latched=before.latched)
    late = order(OverrideKind.RESUME, 1.2).model_copy(update={"first_issued": stamp(0.9)})
    assert not arbiter.override(late, at(1.2)).accepted
    assert arbiter.override(order(OverrideKind.RESUME, 1.3), at(1.3)).accepted


@pytest.mark.parametrize("kind", [OverrideKind.HOLD, OverrideKind.LAND, OverrideKind.EMERGENCY])
def test_every_stop_ends_a_take_off(kind: OverrideKind) -> None:
    arbiter = Arbiter(Rules())
    arbiter.override(order(OverrideKind.TAKE_OFF, 0), at(0))
    arbiter.override(order(kind, 0.1), at(0.1))
    assert arbiter.step(at(0.1)).output is not Output.TAKING_OFF


def test_there_is_no_take_off_in_trouble_after_a_cut_or_after_a_restart() -> None:
    arbiter = Arbiter(Rules())
    assert not arbiter.override(order(OverrideKind.TAKE_OFF, 0), at(0), "no GPS").accepted
    arbiter.override(order(OverrideKind.EMERGENCY, 1), at(1))
    assert not arbiter.override(order(OverrideKind.TAKE_OFF, 1), at(1)).accepted
    arbiter.override(order(OverrideKind.RESUME, 2), at(2))
    assert arbiter.override(order(OverrideKind.TAKE_OFF, 2), at(2)).accepted
    assert Arbiter(Rules(), latched=arbiter.latched).step(at(2)).output is Output.STOPPED
