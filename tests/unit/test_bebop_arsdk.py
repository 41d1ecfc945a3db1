"""ARSDK3 as bytes: against the examples of Parrot's documents, and against any bytes at all."""

import json
import struct

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from juncnet_services.command_output.vehicles import arsdk
from juncnet_services.command_output.vehicles.arsdk import (
    ArsdkError,
    Buffer,
    FlyingState,
    Frame,
    FrameType,
)

FRAMES = st.builds(
    Frame,
    st.sampled_from(FrameType),
    st.integers(0, 255),
    st.integers(0, 255),
    st.binary(max_size=60),
)


def test_a_take_off_has_the_bytes_that_pyparrot_sends() -> None:
    frame = Frame(FrameType.DATA_WITH_ACK, Buffer.WITH_ACK, 5, arsdk.TAKE_OFF)
    assert arsdk.encode(frame) == struct.pack("<BBBIBBH", 4, 11, 5, 11, 1, 0, 1)


def test_a_pcmd_is_percent_right_forward_clockwise_up() -> None:
    expected = struct.pack("<BBHBbbbbI", 1, 0, 2, 1, -10, 20, -30, 40, 0)
    assert arsdk.pcmd(-10, 20, -30, 40, tilt=True) == expected
    assert arsdk.pcmd()[4] == 0


def test_a_setting_is_asked_for_where_its_event_says() -> None:
    assert arsdk.maximum(arsdk.MAX_TILT, 15) == struct.pack("<BBHf", 1, 2, 1, 15)
    assert arsdk.maximum(arsdk.MAX_VERTICAL, 1.5) == struct.pack("<BBHf", 1, 11, 0, 1.5)
    assert arsdk.maximum(arsdk.MAX_ROTATION, 90) == struct.pack("<BBHf", 1, 11, 1, 90)


@given(st.lists(FRAMES, max_size=5))
def test_frames_of_one_datagram_come_out_as_they_went_in(frames: list[Frame]) -> None:
    assert arsdk.decode(b"".join(map(arsdk.encode, frames))) == (frames, b"")


@given(st.binary(max_size=300))
@example(b"\x02\x7f\x00\xff\xff\xff\xff")
@example(b"\x02\x7f\x00\x00\x00\x00\x00")
def test_any_bytes_are_frames_and_a_rest(data: bytes) -> None:
    frames, rest = arsdk.decode(data)
    assert b"".join(map(arsdk.encode, frames)) + rest == data


@given(st.lists(FRAMES, max_size=3), st.binary(min_size=1, max_size=6))
def test_what_is_cut_short_is_the_rest(frames: list[Frame], rest: bytes) -> None:
    assert arsdk.decode(b"".join(map(arsdk.encode, frames)) + rest) == (frames, rest)


@given(st.binary(max_size=40))
def test_any_payload_is_an_event_nothing_or_an_error(payload: bytes) -> None:
    try:
        arsdk.event(payload)
    except ArsdkError:
        return


NUMBERS = [(0, 5, 1), (1, 4, 1), (1, 4, 4), (1, 4, 5), (1, 4, 6), (1, 4, 8), (1, 6, 1), (1, 12, 1)]


@given(st.sampled_from(NUMBERS), st.binary(max_size=40))
def test_known_events_with_any_arguments_are_events_nothing_or_errors(
    number: tuple[int, int, int], arguments: bytes
) -> None:
    try:
        made = arsdk.event(struct.pack("<BBH", *number) + arguments)
    except ArsdkError:
        return
    assert made is not None or number == (1, 4, 4)


def test_events_are_read() -> None:
    assert arsdk.event(arsdk.command(1, 4, 1, "I", 3)) is FlyingState.FLYING
    speed = arsdk.event(arsdk.command(1, 4, 5, "fff", 1, -2, 0.5))
    assert speed == arsdk.Speed(1, -2, 0.5)
    assert arsdk.event(arsdk.command(0, 5, 1, "B", 50)) == arsdk.Battery(0.5)
    assert arsdk.event(arsdk.command(1, 4, 4, "ddd", 500, 500, 500)) is None
    assert arsdk.event(arsdk.command(1, 12, 1, "fff", 80, 10, 200)) == arsdk.Ranges((1, 12, 1), 80)
    with pytest.raises(ArsdkError):
        arsdk.event(arsdk.command(1, 4, 5, "fff", float("nan"), 0, 0))


def test_the_discovery_answer_may_end_in_nuls() -> None:
    assert arsdk.control_port(b'{"status": 0, "c2d_port": 54321}\0\0') == 54321


@pytest.mark.parametrize(
    ("answer", "told"),
    [
        (b'{"status": -3000, "c2d_port": 0}\0', "another controller has it"),
        (b"", "restart it"),
        (b"{", "not JSON"),
        (b"[]", "not a JSON object"),
        (b'{"status": 0, "c2d_port": 99999}', "c2d_port"),
        (b"\xff\xfe", "not JSON"),
        (b"[" * 100_000, "not JSON"),
    ],
)
def test_a_refusal_or_nonsense_in_discovery_says_what_to_do(answer: bytes, told: str) -> None:
    with pytest.raises(ArsdkError, match=told):
        arsdk.control_port(answer)


@given(st.binary(max_size=60))
def test_any_discovery_answer_is_a_port_or_an_error(answer: bytes) -> None:
    try:
        assert 0 < arsdk.control_port(answer) < 65536
    except ArsdkError:
        return


def test_the_request_says_where_this_host_listens() -> None:
    fields = json.loads(arsdk.discovery_request(43210, 55004))
    assert fields["d2c_port"] == 43210
    assert fields["arstream2_client_stream_port"] == 55004
    assert fields["arstream2_client_control_port"] == 55005
    assert fields["controller_type"] == "computer"
