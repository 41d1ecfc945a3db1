"""Whether, in a turn, the next road is in sight, and in which direction."""

import math

from juncnet.messages import RoadCommand, Turn
from juncnet_services.junction_navigation import turning
from juncnet_services.junction_navigation.arms import Sector, arms
from juncnet_services.junction_navigation.config import NavigatorConfig
from juncnet_services.junction_navigation.progress import TurnProgress

WIDER, PATIENCE = 2.0, 50
"""A line that is so much farther off the middle of an arm is taken for it after so many frames."""
MISS = 2
"""Frames with a view that one without it outweighs."""


class RoadSight:
    """Whether the last frames agree on the direction of the next road."""

    def __init__(self, config: NavigatorConfig) -> None:
        self._config, self._confidence = config.turn, config.sight_confidence
        self._agreeing = self._aligned = self._waited = 0
        self.direction_rad: float | None = None
        """Unwrapped yaw of the road seen last, agreed on or not."""
        self.followed = False
        """Whether a follower was sure of that road, in the last view of an arm."""

    def see(self, road: RoadCommand, yaw: float, turn: TurnProgress) -> None:
        """Take a follower's view from `yaw`, in a turn.

        The arms that a map of the surface shows say where the road of the turn leads; the follower
        must be sure of the same one before it takes over.
        """
        axis_rad = turn.nominal_rad - turning.angle_rad(turn.turn)
        sector = turning.sector(turn.turn, turn.in_place, turn.held_back)
        if self._see_arm(road, yaw, sector.turned(axis_rad)):
            turn.arm_rad = self.agreed_rad
            return
        turn.arm_rad = None
        middle, within = turning.search_arc(
            turn.turn, turn.aligning_s, self._config, turn.held_back
        )
        sure = road.confidence >= self._confidence
        heading = turning.seen_heading_rad(road, turn.in_place) if sure else None
        self.look(heading, yaw, turn.nominal_rad + middle, within)

    def see_ahead(self, road: RoadCommand, yaw: float, turn: Turn, axis_rad: float) -> None:
        """Take a follower's view from `yaw`, on a junction that is crossed straight on.

        `axis_rad` is the direction of the road by which the robot came.
        """
        if not self._see_arm(road, yaw, turning.sector(turn).turned(axis_rad)):
            self.look(None, yaw, yaw, 0.0)

    def _see_arm(self, road: RoadCommand, yaw: float, sector: Sector) -> bool:
        """Take the arm that a map shows in a sector of yaws; return whether it shows one."""
        if road.surface is None:
            return False
        found = arms(road.surface).towards(sector.turned(-yaw))
        if found is None:
            return False
        bearing, room_rad = found
        off_rad = math.inf if road.road is None else abs(turning.bearing_rad(road.road) - bearing)
        sure = road.confidence >= self._confidence
        self._waited = self._waited + 1 if sure and off_rad <= WIDER * room_rad else 0
        self.followed = sure and (off_rad <= room_rad or self._waited > PATIENCE)
        self.look(bearing, yaw, yaw + bearing, 0.0, self.followed)
        return True

    def look(
        self,
        heading: float | None,
        yaw: float,
        nominal: float,
        within: float,
        followed: bool = True,
    ) -> None:
        """Take a view from `yaw` of a road, sought `within` so much of `nominal`, or of none.

        One of none counts against two that agreed; a road too far from `nominal` ends the row.
        `followed`: whether a follower may take over on it.
        """
        if heading is None:
            self._agreeing = max(self._agreeing - MISS, 0)
            self._aligned = max(self._aligned - MISS, 0)
            return
        direction = yaw + heading
        if abs(direction - nominal) > within + self._config.sweep_step_rad:
            self.reset()
            return
        previous = self.direction_rad
        near = previous is not None and abs(direction - previous) <= self._config.sweep_step_rad * 2
        enough = self._config.frames + MISS
        self._agreeing = min(self._agreeing + 1, enough) if near else 1
        aligned = followed and abs(heading) <= self._config.aligned_rad
        self._aligned = min(self._aligned + 1, enough) if aligned else 0
        self.direction_rad = direction

    @property
    def agreed_rad(self) -> float | None:
        """Direction of the next road, once enough frames agree."""
        return self.direction_rad if self._agreeing >= self._config.frames else None

    @property
    def aligned(self) -> bool:
        """Whether the robot looks along the next road."""
        return self.agreed_rad is not None and self._aligned >= self._config.frames

    def reset(self) -> None:
        """Forget all frames."""
        self._agreeing = self._aligned = self._waited = 0
        self.direction_rad, self.followed = None, False
