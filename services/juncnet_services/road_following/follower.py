"""The seam for road followers: what a follower is, and how the configured one is loaded.

A follower of one's own is a class anywhere on the Python path:

    class Straight:
        def __init__(self, options):
            self.speed = options.get("speed_mps", 1.0)

        def follow(self, frame, state):
            return Proposal(Velocity(forward_mps=self.speed))
"""

import importlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol, cast, runtime_checkable

from pydantic import BaseModel, ValidationError

from juncnet.camera import CameraGeometry
from juncnet.frames import Frame
from juncnet.messages import RoadCommand, RoadSeen, RoadSurface, VehicleState, Velocity


class FollowerError(Exception):
    """A follower cannot be loaded; the text names the cause and the remedy."""


@dataclass(frozen=True)
class Proposal:
    """What a follower proposes: a velocity, how sure it is (0..1), and the road it saw, if told.

    Without a velocity the robot shall hold. `surface` as in `RoadCommand`.
    """

    velocity: Velocity | None
    confidence: float = 1.0
    road: RoadSeen | None = None
    surface: RoadSurface | None = None


@runtime_checkable
class Follower(Protocol):
    """Keeps a robot on the road: proposes a velocity for every picture.

    Its class is constructed with the configured options: with a dict, or, where the class has an
    attribute `Options` (a pydantic model), with an instance of that. It may have a method
    `reset(reason: str)`, called for every picture of a turn: the road ahead is another one.
    """

    def follow(self, frame: Frame, state: VehicleState | None) -> Proposal | RoadCommand | None:
        """Return the proposal for `frame`, or None: no road is seen, the robot shall hold.

        The pixels of `frame` are read-only and valid during the call only; `state` is the newest
        that the vehicle told, None before the first. Of a `RoadCommand` header and source are
        filled in by the caller.
        """
        ...


def load_follower(
    path: str, options: Mapping[str, Any], camera: CameraGeometry | None = None
) -> Follower:
    """Return the follower `package.module:Class`, constructed with `options`.

    One whose `Options` have a `camera` is given the layout's, unless its options name another.

    Raises:
        FollowerError: there is no such module or class, it is no follower, it refuses its options
            or fails to construct; the text says which and what to do.
    """
    factory = _class_at(path)
    try:
        follower: object = factory(_validated(path, factory, options, camera))
    except FollowerError:
        raise
    except Exception as error:
        raise FollowerError(
            f"follower {path} failed to construct: {type(error).__name__}: {error}"
        ) from error
    if not isinstance(follower, Follower):
        raise FollowerError(
            f"follower {path} has no method follow(frame, state): "
            "see juncnet_services.road_following.follower"
        )
    return follower


def _class_at(path: str) -> Any:
    module_name, _, class_name = path.partition(":")
    if not module_name or not class_name:
        raise FollowerError(f"follower {path!r} is not of the form package.module:Class")
    try:
        module = importlib.import_module(module_name)
    except ImportError as error:
        raise FollowerError(
            f"follower {path}: cannot import {module_name} ({error}); install it into this "
            "environment or put its folder on PYTHONPATH"
        ) from error
    factory: object = getattr(module, class_name, None)
    if not callable(factory):
        known = sorted(n for n, v in vars(module).items() if isinstance(v, type) and n[0] != "_")
        raise FollowerError(
            f"follower {path}: {module_name} has no class {class_name}; it has {', '.join(known)}"
        )
    return factory


def _validated(
    path: str, factory: Any, options: Mapping[str, Any], camera: CameraGeometry | None
) -> Any:
    model: object = getattr(factory, "Options", None)
    if not (isinstance(model, type) and issubclass(model, BaseModel)):
        return dict(options)
    unknown = sorted(set(options) - set(model.model_fields))
    if unknown:
        raise FollowerError(
            f"follower {path} has no option {', '.join(unknown)}; "
            f"it has {', '.join(sorted(model.model_fields))}"
        )
    if camera is not None and "camera" in model.model_fields:
        options = {"camera": camera, **options}
    try:
        return cast(Any, model).model_validate(dict(options))
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(str(part) for part in first["loc"]) or "options"
        raise FollowerError(f"follower {path}, option {where}: {first['msg']}") from error
