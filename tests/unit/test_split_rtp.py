"""RTP and H.264 out of it: what comes out is whole and in order, whatever comes in."""

import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from juncnet_services.frame_capture.contract import AccessUnit, Counts
from juncnet_services.frame_capture.h264 import START_CODE, split_annex_b
from juncnet_services.frame_capture.h264_rtp import MAX_PAYLOAD, Depacketiser, packetise
from juncnet_services.frame_capture.rtp import (
    WAITING,
    RtpError,
    RtpOrder,
    RtpPacket,
    is_picture_loss_indication,
    parse_rtp,
    picture_loss_indication,
)

SPS, PPS = b"\x67\x42\x00\x1f\xe9", b"\x68\xce\x38\x80"


def picture(kind: int, fill: int, size: int = 3 * MAX_PAYLOAD) -> bytes:
    """A NAL unit that begins a picture: first_mb_in_slice is 0."""
    return bytes([0x60 | kind, 0x88 | fill % 8]) + bytes([1 + fill % 200]) * size


def key(fill: int) -> list[bytes]:
    return [SPS, PPS, picture(5, fill)]


def stream(units: list[list[bytes]], sequence: int = 65530) -> list[bytes]:
    """The datagrams of access units, 25 a second; sequence numbers wrap on the way."""
    datagrams: list[bytes] = []
    for index, nals in enumerate(units):
        sent = list(packetise(nals, sequence, 3600 * index, 77))
        sequence = (sequence + len(sent)) % 0x10000
        datagrams += sent
    return datagrams


def received(datagrams: list[bytes], counts: Counts | None = None) -> list[AccessUnit]:
    order, pictures = RtpOrder(), Depacketiser(counts or Counts())
    return [
        unit
        for index, datagram in enumerate(datagrams)
        for lost, packet in order.push(parse_rtp(datagram))
        for unit in pictures.push(packet, lost, index)
    ]


UNITS = [key(0), *([picture(1, n)] for n in range(1, 4)), key(4), [picture(1, 5, 20)]]


def test_access_units_come_out_as_they_went_in() -> None:
    units = received(stream(UNITS))
    assert [split_annex_b(unit.payload) for unit in units] == UNITS
    assert [unit.key_frame for unit in units] == [True, False, False, False, True, False]
    assert {unit.lost_before for unit in units} == {0}


def test_packets_that_overtake_each_other_are_put_in_order() -> None:
    datagrams = stream(UNITS)
    swapped = datagrams[:]
    for index in range(1, len(swapped) - 3, 4):
        swapped[index], swapped[index + 2] = swapped[index + 2], swapped[index]
    assert [u.payload for u in received(swapped)] == [u.payload for u in received(datagrams)]


@given(st.data())
@settings(max_examples=200, deadline=None)
def test_whatever_is_lost_or_doubled_only_whole_pictures_come_out(data: st.DataObject) -> None:
    units = [key(0), *([picture(1, n)] for n in range(1, 12))]
    datagrams = stream(units)
    fates = data.draw(
        st.lists(st.sampled_from([0, 1, 1, 1, 1, 2]), min_size=len(datagrams),
                 max_size=len(datagrams))
    )  # fmt: skip
    arriving = [d for d, fate in zip(datagrams, fates, strict=True) for _ in range(fate)]
    known = {START_CODE + START_CODE.join(nals) for nals in units}
    out = received(arriving)
    assert {unit.payload for unit in out} <= known
    places = [[*known].index(unit.payload) for unit in out]
    assert len(set(places)) == len(places)


def test_a_loss_is_told_with_the_next_whole_picture() -> None:
    datagrams = stream(UNITS)
    gone = next(i for i, d in enumerate(datagrams) if parse_rtp(d).timestamp == 3600)
    counts = Counts()
    units = received(datagrams[: gone + 1] + datagrams[gone + 2 :] * 2, counts)
    assert [split_annex_b(u.payload) for u in units][:2] == [UNITS[0], UNITS[2]]
    assert units[1].lost_before == 1
    assert counts.lost == 1


def test_a_key_frame_without_parameter_sets_gets_those_before_it() -> None:
    units = received(stream([key(0), [picture(5, 1)]]))
    assert split_annex_b(units[1].payload) == [SPS, PPS, picture(5, 1)]


def test_a_key_frame_whose_parameter_sets_never_came_is_not_given() -> None:
    assert received(stream([[picture(5, 1)]])) == []


def test_parameter_sets_in_a_stap_are_unpacked() -> None:
    stap = b"\x78" + b"".join(struct.pack(">H", len(n)) + n for n in (SPS, PPS))
    pictures, slice_ = Depacketiser(Counts()), picture(5, 2, 40)
    assert pictures.push(RtpPacket(1, 0, False, 96, 7, stap), 0, 10) == []
    (unit,) = pictures.push(RtpPacket(2, 0, True, 96, 7, slice_), 0, 20)
    assert split_annex_b(unit.payload) == [SPS, PPS, slice_]
    assert unit.key_frame
    assert unit.captured_ns == 10


def test_a_picture_that_is_too_large_is_dropped() -> None:
    counts, pictures = Counts(), Depacketiser(Counts())
    pictures = Depacketiser(counts)
    part = b"\x61" + bytes(1 << 20)
    for number in range(10):
        pictures.push(RtpPacket(number, 0, number == 9, 96, 7, part), 0, 0)
    assert counts.corrupt > 0
    assert pictures.push(RtpPacket(10, 1, True, 96, 7, picture(1, 1, 9)), 0, 0)[0].lost_before == 1


def test_a_sender_that_begins_anew_is_followed() -> None:
    units = received(stream(UNITS[:2], 100) + stream(UNITS[4:], 40000))
    assert split_annex_b(units[-1].payload) == UNITS[-1]


def test_order_waits_no_longer_than_it_must() -> None:
    order = RtpOrder()
    packets = [RtpPacket(n, 0, False, 96, 7, b"x") for n in range(WAITING + 3)]
    assert order.push(packets[0]) == [(0, packets[0])]
    released = [pair for packet in packets[2:] for pair in order.push(packet)]
    assert released[0] == (1, packets[2])
    assert [packet.sequence for _, packet in released] == list(range(2, WAITING + 3))


@pytest.mark.parametrize(
    ("datagram", "why"),
    [
        (b"\x80" * 11, "too few"),
        (b"\x40" + bytes(20), "version"),
        (b"\x90" + bytes(11), "extension"),
        (b"\xa0" + bytes(11) + b"\xff", "longer"),
        (b"\x8f" + bytes(12), "longer"),
    ],
)
def test_what_is_no_rtp_is_refused(datagram: bytes, why: str) -> None:
    with pytest.raises(RtpError, match=why):
        parse_rtp(datagram)


@given(st.lists(st.binary(max_size=80), max_size=30))
@settings(max_examples=500, deadline=None)
def test_arbitrary_datagrams_crash_nothing(datagrams: list[bytes]) -> None:
    order, pictures = RtpOrder(), Depacketiser(Counts())
    for datagram in datagrams:
        try:
            packet = parse_rtp(datagram)
        except RtpError:
            continue
        for lost, released in order.push(packet):
            for unit in pictures.push(released, lost, 0):
                assert unit.payload.startswith(START_CODE)


@given(st.lists(st.tuples(st.binary(max_size=40), st.booleans(), st.integers(0, 2)), max_size=40))
@settings(max_examples=500, deadline=None)
def test_arbitrary_payloads_in_sound_packets_crash_nothing(
    parts: list[tuple[bytes, bool, int]],
) -> None:
    pictures, timestamp = Depacketiser(Counts()), 0
    for number, (payload, marker, step) in enumerate(parts):
        timestamp += step
        packet = RtpPacket(number, timestamp, marker, 96, 7, payload)
        for unit in pictures.push(packet, step == 2, number):
            assert unit.payload.startswith(START_CODE)
            assert unit.lost_before >= 0


def test_a_key_frame_is_asked_for_by_rtcp() -> None:
    asked = picture_loss_indication(0xDEADBEEF)
    assert is_picture_loss_indication(asked)
    assert asked[-4:] == b"\xde\xad\xbe\xef"
    assert not is_picture_loss_indication(stream(UNITS)[0])
