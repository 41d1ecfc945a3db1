"""Keys held down as a velocity, for flying by keyboard. Pure: `now_ns` is an argument.

A terminal tells of a held key only by repeating it, so a key counts as held for `HELD_NS` after
each time it was read: whoever lets go, or whose terminal hangs, sends zero.
"""

from dataclasses import dataclass

from juncnet.messages import Velocity

HELD_NS = 200_000_000
AXES = {
    "w": ("forward", 1),
    "s": ("forward", -1),
    "up": ("forward", 1),
    "down": ("forward", -1),
    "a": ("yaw", 1),
    "d": ("yaw", -1),
    "left": ("yaw", 1),
    "right": ("yaw", -1),
    "q": ("lateral", 1),
    "e": ("lateral", -1),
    "r": ("vertical", 1),
    "f": ("vertical", -1),
}
_ARROWS = {"A": "up", "B": "down", "C": "right", "D": "left"}
_NAMES = {" ": "space", "\x03": "leave", "\x1b": "leave", "x": "leave", "\x04": "leave"}


@dataclass(frozen=True)
class Speeds:
    """How fast a held key moves the robot: m/s, rad/s."""

    forward: float = 1.0
    lateral: float = 0.5
    vertical: float = 0.5
    yaw: float = 0.6


class Stick:
    """The keys held down now."""

    def __init__(self, speeds: Speeds) -> None:
        self._speeds = speeds
        self._pressed: dict[str, tuple[int, int]] = {}

    def press(self, key: str, now_ns: int) -> bool:
        """Take a key that was read at `now_ns`; return whether it moves the robot."""
        if key not in AXES:
            return False
        axis, direction = AXES[key]
        self._pressed[axis] = (direction, now_ns)
        return True

    def release(self) -> None:
        """Forget all keys."""
        self._pressed.clear()

    def velocity(self, now_ns: int) -> Velocity:
        """Return what the keys held at `now_ns` ask for; zero on every axis without one."""
        rates = {
            axis: direction * float(getattr(self._speeds, axis))
            for axis, (direction, since_ns) in self._pressed.items()
            if 0 <= now_ns - since_ns < HELD_NS
        }
        return Velocity(
            forward_mps=rates.get("forward", 0.0),
            lateral_mps=rates.get("lateral", 0.0),
            vertical_mps=rates.get("vertical", 0.0),
            yaw_rate_radps=rates.get("yaw", 0.0),
        )


def key_names(text: str) -> list[str]:
    """Return the keys in what a terminal in raw mode sent, in order; unknown ones are left out.

    A lone escape, control-C, control-D and x are `leave`; a blank is `space`.
    """
    names: list[str] = []
    rest = text
    while rest:
        if rest[:2] in ("\x1b[", "\x1bO") and len(rest) > 2:
            name = _ARROWS.get(rest[2], "")
            rest = rest[3:]
        else:
            name = _NAMES.get(rest[0], rest[0].lower())
            rest = rest[1:]
        if name:
            names.append(name)
    return names
