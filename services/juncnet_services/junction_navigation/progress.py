"""What the navigator knows of the flight so far: one record, which is also what is saved."""

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from juncnet.messages import JunctionEvent, Mission, Name, Phase, Turn

SURE = 4.0
"""Weight from which on a place is believed."""


class Place(BaseModel):
    """A place along the robot's way that several pictures show."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)

    at_m: float = 0.0
    """Odometer reading there."""
    weight: float = Field(default=0.0, ge=0)
    """Sum of the pictures' inverse variances (1/m^2); 0: not seen yet."""

    @property
    def sure(self) -> bool:
        """Whether enough pictures agree on it."""
        return self.weight >= SURE


class Sighting(BaseModel):
    """An opening in the road's edge, seen in several pictures. Distances are odometer readings."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)

    side: Literal["left", "right"]
    near_m: float
    """Where the edge ends."""
    far_m: float | None = None
    """Where it begins anew, once that was seen."""
    weight: float = Field(gt=0)
    """Of `near_m`: the sum of the pictures' inverse variances."""
    frames: int = Field(default=1, ge=1)
    """Pictures in which the near end was seen."""
    missed: int = Field(default=0, ge=0)
    """Pictures in which it was not, though it should have been."""
    first_m: float
    """Where the robot was when it was first seen; `last_m`: last."""
    last_m: float
    scored: int = Field(default=0, ge=0)
    """Scores that came while the score of a junction there should be high."""
    probability: float = Field(default=0.0, ge=0, le=1)
    """Mean smoothed score of those."""
    robot_m: float = 0.0
    """Mean of where the robot was in those pictures; `place_m`: of where the edge ended in them."""
    place_m: float = 0.0
    scatter_m2: float = Field(default=0.0, ge=0)
    """Sum of squares of the former around their mean; `joint_m2`: of the products of both."""
    joint_m2: float = 0.0
    depth: int = 0
    """How many more maps showed a road that leads on there than that showed none."""

    def place(self, at_m: float, near_m: float) -> None:
        """Take one more picture into the means and sums."""
        apart_m = at_m - self.robot_m
        self.robot_m += apart_m / self.frames
        self.place_m += (near_m - self.place_m) / self.frames
        self.scatter_m2 += apart_m * (at_m - self.robot_m)
        self.joint_m2 += apart_m * (near_m - self.place_m)

    @property
    def drift(self) -> float:
        """How far the edge's end went along with the robot, per metre: 0 of what stands still."""
        return self.joint_m2 / self.scatter_m2 if self.scatter_m2 > 0 else 0.0


class SeenWay(BaseModel):
    """A way on behind a junction. The angle is an unwrapped yaw in radians."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)

    leads_rad: float
    """Its direction;"""
    at_m: float
    """and where the robot was that saw it, an odometer reading in metres."""


class Junction(BaseModel):
    """A junction ahead or under the robot. Distances are odometer readings in metres."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)

    rise_m: float
    """Where the score rose."""
    rise_seen: bool = True
    """False when the score was already high: the junction may be nearer than `d_far` says."""
    fall_m: float | None = None
    """Where the score fell; None while it is high."""
    label: Name = "junction"
    probability: float = Field(default=0.0, ge=0, le=1)
    """Highest smoothed probability so far."""
    sightings: list[Sighting] = Field(default_factory=list[Sighting])
    """Its openings, at most one of either side."""
    end: Place = Field(default_factory=Place)
    """Where the robot's road ends beyond it, as at a T."""
    far: Place = Field(default_factory=Place)
    """Where an edge of the robot's road begins anew beyond it, seen while crossing it."""
    axis_rad: float | None = None
    """Direction of the road by which the robot entered it; None: it has not."""
    way: SeenWay | None = None
    """The road behind it, as a follower was first sure of it while the robot crosses it."""


class TurnProgress(BaseModel):
    """A turn under way. Angles are unwrapped yaws in radians."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)

    turn: Turn
    nominal_rad: float
    """Yaw that the mission asks for."""
    arm_rad: float | None = None
    """Bearing of its road, where a map of the surface shows it."""
    radius_m: float = Field(default=0.0, ge=0)
    """Of the arc; 0: in place."""
    started_m: float = 0.0
    """Odometer reading where it began."""
    held_back: bool = False
    """Whether the road's surface leaves no room for its arc."""
    elapsed_s: float = Field(default=0.0, ge=0)
    """Time under way, holds not counted."""
    aligning_s: float = Field(default=0.0, ge=0)
    """Time since the nominal angle was reached, holds not counted."""
    aligning_from_m: float | None = None
    """Odometer reading where an arc's search for its road began; None: it has not."""
    ended_m: float | None = None
    """Odometer reading where the robot was on its road; None: it is under way."""
    lost_s: float = Field(default=0.0, ge=0)
    """Time without a road in sight since the turn ended, holds not counted."""
    searched_anew: int = Field(default=0, ge=0)
    """How often its road was lost and searched anew."""

    @property
    def in_place(self) -> bool:
        """Whether the robot turns on the spot, not on an arc."""
        return self.radius_m == 0

    @property
    def searching_anew(self) -> "TurnProgress":
        """This turn with its search for the road begun again."""
        begun = {
            "aligning_s": 0.0,
            "aligning_from_m": None,
            "arm_rad": None,
            "ended_m": None,
            "lost_s": 0.0,
        }
        return self.model_copy(update={**begun, "searched_anew": self.searched_anew + 1})


class Progress(BaseModel):
    """The state of the navigator. It is saved whole, and a restarted navigator goes on with it."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)

    flight: Name
    configured: Mission
    """The mission of the configuration: another one there means another mission here."""
    mission: Mission
    phase: Phase = Phase.WAITING
    count: int = Field(default=0, ge=0)
    index: int = Field(default=0, ge=0)
    """Of the next event."""
    events: tuple[JunctionEvent, ...] = ()
    """The latest events: published again after a restart, for they may not have left."""
    odometer_m: float = 0.0
    speed_mps: float = 0.0
    yaw_rad: float = 0.0
    """Unwrapped."""
    position_m: tuple[float, float] | None = None
    """Of the vehicle's pose, where it has one."""
    smoothed: float = Field(default=0.0, ge=0, le=1)
    high: bool = False
    fell_m: float | None = None
    """Odometer reading where the score fell last."""
    candidate: Junction | None = None
    """A risen score that has not been counted."""
    junction: Junction | None = None
    """The junction that was counted last, until it is left."""
    sightings: list[Sighting] = Field(default_factory=list[Sighting])
    """Openings ahead that are no counted junction's."""
    axis_rad: float | None = None
    """Direction of the road that the robot is on."""
    turn: TurnProgress | None = None
    turned: TurnProgress | None = None
    """The turn that was made at the junction, until that is left."""
    leave_m: float | None = None
    """Odometer reading at which a junction where the robot turned is left."""
    left_m: float | None = None
    """Odometer reading where the last junction was left."""
    left_turned: bool = False
    """Whether the robot turned there."""

    @property
    def turn_here(self) -> Turn:
        """What the mission says of the junction that was counted last, or of the first."""
        return self.mission.turn_at(max(self.count, 1))

    @property
    def at_last_junction(self) -> bool:
        """Whether the mission is finished once the junction that was counted last is left."""
        last = self.mission.finish_after
        return last is not None and self.count >= last

    @property
    def heading_rad(self) -> float:
        """Direction of the road that the robot is on; its own as long as that is not known."""
        return self.yaw_rad if self.axis_rad is None else self.axis_rad
