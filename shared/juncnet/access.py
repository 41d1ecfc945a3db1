"""Who may do what on a vehicle's router: roles, and the Zenoh access rules made from them. Pure.

A role is the common name of a certificate. What it may publish follows from the table of topics:
the topics of the services that it stands for, and nothing else. Everything is denied by default,
a wildcard that is wider than a right too. Rights hold for every robot whose router trusts the CA.

Processes on the vehicle's own host meet in a private directory (0700) and may do everything.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from juncnet.topics import (
    ROOT,
    SERVICES,
    TOPICS,
    FrameTopic,
    Request,
    Topic,
    clock_key,
    health_topic,
)

VEHICLE_SIDE = "command_output"
"""The service that moves the vehicle: no link but the vehicle's own host speaks for it."""


class Role(StrEnum):
    """What a certificate is for; its common name."""

    DRONE = "drone"
    """The vehicle's router. It only answers: nobody can link to a vehicle with it."""
    NAVIGATION = "navigation"
    """The laptop: every service but command_output. The only one that may publish velocities."""
    OPERATOR = "operator"
    """Overrides, missions, models."""
    RECORDER = "recorder"
    """Looks, and reports its own health."""
    VIEWER = "viewer"
    """Looks."""


@dataclass(frozen=True)
class Rights:
    """What a role may do besides looking."""

    speaks_for: tuple[str, ...] = ()
    """The publishers, as the table of topics names them, whose topics and requests are its own."""
    asks: bool = False
    """Whether it may send the requests of operators."""
    tells_time: bool = False
    """Whether it may say what a clock shows, on which the age of commands depends."""


RIGHTS: dict[Role, Rights] = {
    Role.NAVIGATION: Rights(
        speaks_for=tuple(s for s in SERVICES if s != VEHICLE_SIDE), tells_time=True
    ),
    Role.OPERATOR: Rights(speaks_for=("operator",), asks=True, tells_time=True),
    Role.RECORDER: Rights(speaks_for=("recorder",)),
    Role.VIEWER: Rights(),
}
"""The roles that may link to a vehicle's router."""

_LOOK = ("declare_subscriber", "liveliness_query", "declare_liveliness_subscriber")
_SPEAK = ("put", "reply", "declare_queryable", "liveliness_token")
_ALL = (*_LOOK, *_SPEAK, "delete", "query")
_HISTORY = "@adv/**"
"""Where Zenoh's advanced publishers keep history and tell what they have sent."""
_CLOCKS = clock_key("*", "*")
_EVERYTHING = (f"{ROOT}/**", f"{ROOT}/**/{_HISTORY}")
_ON_THIS_HOST = "this-host"


def may_publish(role: Role, topic: Topic[Any]) -> bool:
    """Return whether a link with the certificate of `role` may publish `topic`."""
    return role in RIGHTS and topic.publisher in RIGHTS[role].speaks_for


def access_control() -> dict[str, Any]:
    """Return the section `access_control` of the Zenoh configuration of a vehicle's router."""
    rules = [
        _rule("everything", _ALL, _EVERYTHING, "ingress", "egress"),
        _rule("hear", _ALL, _EVERYTHING, "egress"),
        _rule("no-raw-pictures", ("put",), _frames(), "egress", permission="deny"),
        _rule("look", _LOOK, _EVERYTHING, "ingress"),
        _rule("ask-history-and-time", ("query",), (f"{ROOT}/**/{_HISTORY}", _CLOCKS), "ingress"),
    ]
    subjects: list[dict[str, Any]] = [
        {"id": _ON_THIS_HOST, "link_protocols": ["unixsock-stream"]},
    ]
    policies: list[dict[str, Any]] = [{"rules": ["everything"], "subjects": [_ON_THIS_HOST]}]
    for role, rights in RIGHTS.items():
        own = list(_own_rules(role, rights))
        rules += own
        subjects.append(
            {"id": role, "cert_common_names": [role], "link_protocols": ["tls", "quic"]}
        )
        looking = ["hear", "no-raw-pictures", "look", "ask-history-and-time"]
        policies.append({"rules": looking + [r["id"] for r in own], "subjects": [role]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": subjects,
        "policies": policies,
    }


def _own_rules(role: Role, rights: Rights) -> Iterable[dict[str, Any]]:
    topics = [t for t in TOPICS if isinstance(t, Topic) and may_publish(role, t)]
    topics += [health_topic(service) for service in rights.speaks_for]
    serves = [t for t in TOPICS if isinstance(t, Request) and t.server in rights.speaks_for]
    keys = [topic.expression("*") for topic in (*topics, *serves)]
    if keys:
        yield _rule(f"{role}-speaks", _SPEAK, [*keys, *(f"{k}/{_HISTORY}" for k in keys)])
    if rights.tells_time:
        yield _rule(f"{role}-tells-time", ("declare_queryable", "reply"), (_CLOCKS,))
    if rights.asks:
        requests = [t.expression("*") for t in TOPICS if isinstance(t, Request)]
        yield _rule(f"{role}-asks", ("query",), requests)


def _frames() -> list[str]:
    return [topic.expression("*") for topic in TOPICS if isinstance(topic, FrameTopic)]


def _rule(
    name: str,
    messages: Iterable[str],
    keys: Iterable[str],
    *flows: str,
    permission: str = "allow",
) -> dict[str, Any]:
    return {
        "id": name,
        "messages": list(messages),
        "flows": list(flows or ("ingress",)),
        "permission": permission,
        "key_exprs": list(keys),
    }
