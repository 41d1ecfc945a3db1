"""The table of topics: every key once, every topic carries a message that says what it is."""

import pytest

from juncnet import topics as t
from juncnet.messages import MessageError


def test_keys_are_unique() -> None:
    keys = [topic.key for topic in t.TOPICS]
    assert len(keys) == len(set(keys)) == 20


def test_keys_are_below_root_and_robot() -> None:
    for topic in t.TOPICS:
        assert topic.expression("robot") == f"juncnet/robot/{topic.key}"
        assert not set("*$?#@") & set(topic.key)
    assert t.health_topic("*").expression("*") == "juncnet/*/health/*"


def test_encodings_name_their_schema() -> None:
    for topic in t.TOPICS:
        if isinstance(topic, t.Topic):
            assert topic.message.encoding().endswith(f";{topic.message.schema_name()}")


def test_every_service_publishes_something() -> None:
    publishers = {x.publisher for x in t.TOPICS if not isinstance(x, t.Request)}
    assert set(t.SERVICES) <= publishers
    servers = {x.server for x in t.TOPICS if isinstance(x, t.Request)}
    assert servers <= set(t.SERVICES)


def test_what_moves_the_robot_is_a_command() -> None:
    assert t.COMMAND_VELOCITY.qos is t.COMMAND_OVERRIDE.qos is t.Qos.COMMAND
    assert t.JUNCTION_EVENT.qos is t.Qos.EVENT
    assert t.MODEL_ACTIVE.qos is t.NAVIGATION_STATE.qos is t.Qos.KEPT


def test_what_is_published_with_wildcards_is_of_no_robot() -> None:
    assert t.COMMAND_VELOCITY.robot_of("juncnet/scout/command/velocity") == "scout"
    for key in ("juncnet/*/command/velocity", "juncnet/scout/**", "**", "juncnet/sc$*/command/x"):
        with pytest.raises(MessageError, match="wildcards"):
            t.COMMAND_VELOCITY.robot_of(key)
