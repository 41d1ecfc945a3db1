"""Whatever arrives, a decoder gives a valid message or says what is wrong; nothing else happens.

A million malformed inputs with `--full`, a few thousand by default.
"""

import json
import random
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from test_messages import CARRIERS, EXAMPLES

from decoders import mutated
from juncnet import topics as t
from juncnet.messages import BulkMessage, Message, MessageError

Carrier = t.Topic[Any] | t.Request[Any]
JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=20),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=12), inner),
    max_leaves=12,
)


def survives(topic: Carrier, payload: bytes, attachment: bytes | None) -> Message | None:
    """Decode; a message that came through must come through again, as the same bytes."""
    problem, message = "", None
    try:
        message = topic.message.decode(payload, attachment)
    except MessageError as error:
        problem = str(error)
    if message is None:
        assert problem.startswith(topic.message.__name__)
        return None
    again = topic.message.decode(*message.encode())
    assert again == message
    return message


def bulk(topic: Carrier) -> bool:
    return issubclass(topic.message, BulkMessage)


@settings(max_examples=300, deadline=None)
@given(st.sampled_from(CARRIERS), st.binary(max_size=200), st.none() | st.binary(max_size=200))
def test_bytes_of_any_kind(topic: Carrier, payload: bytes, attachment: bytes | None) -> None:
    survives(topic, payload, attachment)


@settings(max_examples=300, deadline=None)
@given(st.sampled_from(CARRIERS), JSON, st.binary(max_size=64))
def test_json_of_any_kind(topic: Carrier, value: Any, data: bytes) -> None:
    text = json.dumps(value).encode()
    survives(topic, *((data, text) if bulk(topic) else (text, None)))


@settings(max_examples=600, deadline=None)
@given(st.sampled_from(CARRIERS), st.data())
def test_a_field_of_any_kind(topic: Carrier, data: st.DataObject) -> None:
    payload, attachment = EXAMPLES[topic.key].encode()
    fields = json.loads(attachment or payload)
    fields[data.draw(st.sampled_from(sorted(fields)))] = data.draw(JSON)
    text = json.dumps(fields).encode()
    survives(topic, *((payload, text) if bulk(topic) else (text, None)))


@pytest.mark.parametrize("depth", [100, 100_000])
def test_json_that_is_nested_too_deep(depth: int) -> None:
    for topic in CARRIERS:
        text = b'{"header":' * depth
        assert survives(topic, text, text) is None
        assert survives(topic, b"[" * depth + b"]" * depth, b"[" * depth) is None


@pytest.mark.parametrize("count", [100, pytest.param(65_000, marks=pytest.mark.full)])
@pytest.mark.parametrize("topic", CARRIERS, ids=lambda topic: topic.key)
def test_messages_that_were_damaged(topic: Carrier, count: int) -> None:
    chance = random.Random(topic.key)
    payload, attachment = EXAMPLES[topic.key].encode()
    short = payload[:64] if attachment is None or len(payload) < 64 else payload
    refused = 0
    for _ in range(count):
        if attachment is None:
            refused += survives(topic, mutated(payload, chance), None) is None
        elif chance.random() < 0.2:
            refused += survives(topic, mutated(short, chance), attachment) is None
        else:
            refused += survives(topic, payload, mutated(attachment, chance)) is None
    assert refused > count / 3
