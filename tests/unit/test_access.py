"""Who may do what at a vehicle's router: the rules follow from the table of topics, and hold."""

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from juncnet import topics as t
from juncnet.access import RIGHTS, Role, access_control, may_publish

RULES: dict[str, Any] = access_control()
COMMANDS = {t.COMMAND_VELOCITY.key, t.COMMAND_OVERRIDE.key}
CHUNKS = ["juncnet", "robot", "*", "**", "command", "velocity", "override", "health", "x", "@adv"]


def rules_of(role: str, message: str, flow: str, permission: str) -> list[str]:
    """Return the key expressions of the rules of this role for this message."""
    named = {rule["id"]: rule for rule in RULES["rules"]}
    return [
        key
        for policy in RULES["policies"]
        if role in policy["subjects"]
        for rule in (named[name] for name in policy["rules"])
        if message in rule["messages"] and flow in rule["flows"]
        if rule["permission"] == permission
        for key in rule["key_exprs"]
    ]


def includes(wide: list[str], narrow: list[str]) -> bool:
    """Return whether one key expression includes another, as Zenoh defines it, chunk by chunk."""
    if not wide:
        return not narrow
    if wide[0] == "**":
        hides = bool(narrow) and narrow[0].startswith("@")
        return includes(wide[1:], narrow) or (
            bool(narrow) and not hides and includes(wide, narrow[1:])
        )
    if not narrow or narrow[0] == "**":
        return False
    same = wide[0] == narrow[0] or (wide[0] == "*" and not narrow[0].startswith("@"))
    return same and includes(wide[1:], narrow[1:])


def allowed(role: str, message: str, key: str, flow: str = "ingress") -> bool:
    """Return what Zenoh decides: deny wins, allow must include the whole key, else denied."""

    def covered(permission: str) -> bool:
        rules = rules_of(role, message, flow, permission)
        return any(includes(rule.split("/"), key.split("/")) for rule in rules)

    return covered("allow") and not covered("deny")


def test_everything_is_denied_unless_allowed() -> None:
    assert RULES["enabled"] is True
    assert RULES["default_permission"] == "deny"
    assert [rule["id"] for rule in RULES["rules"] if rule["permission"] == "deny"] == [
        "no-raw-pictures"
    ]


def test_only_navigation_publishes_velocities_and_only_an_operator_overrides() -> None:
    velocity, override = (x.expression("robot") for x in (t.COMMAND_VELOCITY, t.COMMAND_OVERRIDE))
    assert [role for role in Role if allowed(role, "put", velocity)] == [Role.NAVIGATION]
    assert [role for role in Role if allowed(role, "put", override)] == [Role.OPERATOR]
    for request in (t.MISSION_SET, t.MODEL_LOAD):
        asks = [role for role in Role if allowed(role, "query", request.expression("robot"))]
        assert asks == [Role.OPERATOR]


def test_nobody_speaks_for_the_vehicle() -> None:
    for topic in (t.VEHICLE_STATE, t.COMMAND_ACK, t.health_topic("command_output")):
        assert not any(allowed(role, "put", topic.expression("robot")) for role in Role)


def test_only_who_commands_says_what_a_clock_shows() -> None:
    key, of_any_robot = (t.clock_key(robot, "boot-1") for robot in ("robot", "*"))
    for message, told in (("declare_queryable", of_any_robot), ("reply", key)):
        tells = [role for role in Role if allowed(role, message, told)]
        assert tells == [Role.NAVIGATION, Role.OPERATOR]
    assert all(allowed(role, "query", key) for role in RIGHTS)


@pytest.mark.parametrize("role", list(RIGHTS))
def test_every_role_looks_but_at_no_raw_pictures(role: Role) -> None:
    for topic in t.TOPICS:
        key = topic.expression("robot")
        assert allowed(role, "declare_subscriber", key)
        assert allowed(role, "put", key, "egress") is not isinstance(topic, t.FrameTopic)
    assert allowed(role, "query", f"{t.JUNCTION_EVENT.expression('*')}/@adv/**")


def test_a_viewer_only_looks() -> None:
    for message in ("put", "delete", "reply", "declare_queryable", "liveliness_token"):
        assert rules_of(Role.VIEWER, message, "ingress", "allow") == []


@pytest.mark.parametrize("topic", [x for x in t.TOPICS if isinstance(x, t.Topic)])
def test_rules_and_table_agree(topic: t.Topic[Any]) -> None:
    for role in Role:
        assert allowed(role, "put", topic.expression("robot")) == may_publish(role, topic)
        assert not allowed(role, "delete", topic.expression("robot"))


def test_the_vehicles_certificate_may_not_link() -> None:
    assert Role.DRONE not in RIGHTS
    names = [name for s in RULES["subjects"] for name in s.get("cert_common_names", [])]
    assert names == list(RIGHTS)
    for subject in RULES["subjects"]:
        assert subject.get("cert_common_names") or subject["link_protocols"] == ["unixsock-stream"]


@given(st.sampled_from(list(Role)), st.lists(st.sampled_from(CHUNKS), min_size=1, max_size=6))
def test_no_wildcard_is_wider_than_a_right(role: Role, chunks: list[str]) -> None:
    key = "/".join(chunks)
    if not allowed(role, "put", key):
        return
    published = [x.expression("*") for x in t.TOPICS if isinstance(x, t.Topic)]
    published += [t.health_topic(name).expression("*") for name in RIGHTS[role].speaks_for]
    own = [p for p in published if includes(p.split("/"), chunks[:4])]
    assert own
    for command in COMMANDS & {p.removeprefix("juncnet/*/") for p in own}:
        assert role is (Role.NAVIGATION if "velocity" in command else Role.OPERATOR)
