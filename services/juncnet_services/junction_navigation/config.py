"""The options of the navigator, with their units and defaults."""

from pydantic import BaseModel, ConfigDict, Field, model_validator

from juncnet.camera import CameraGeometry
from juncnet.messages import Name


class DetectorConfig(BaseModel):
    """When a score counts as risen or fallen, and as which junction."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    smoothing_s: float = Field(default=0.12, gt=0, le=2.0)
    """Time constant of the exponential smoothing."""
    enter: float = Field(default=0.5, gt=0, lt=1)
    """Smoothed probability at which the score has risen."""
    leave: float = Field(default=0.35, gt=0, lt=1)
    """Smoothed probability at which it has fallen."""
    certain: float = Field(default=0.93, ge=0, lt=1)
    """Smoothed probability that a risen score must reach before the junction is counted: what is no
    junction seldom looks like one all the way, a junction does when it is near."""
    confirm_fraction: float = Field(default=0.2, ge=0, le=0.6)
    """Part of the band that a risen score must last before the junction is counted."""
    likely: float = Field(default=0.75, ge=0, lt=1)
    """What it must reach when it lasts for `long_fraction` of the band."""
    long_fraction: float = Field(default=0.65, ge=0, le=1)
    """Part of the band that a risen score must last to be counted without being certain."""
    dip_m: float = Field(default=2.5, ge=0)
    """A fallen score that rises again within this distance was no fall."""
    gap_m: float = Field(default=3.0, ge=0)
    """Distance after a junction was crossed straight on and left within which no other is counted
    by its score alone."""

    @model_validator(mode="after")
    def _hysteresis(self) -> "DetectorConfig":
        if self.leave >= self.enter:
            raise ValueError("leave must be below enter")
        return self


class TurnConfig(BaseModel):
    """How a turn is made."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    yaw_gain_per_s: float = Field(default=1.6, gt=0, le=10)
    """Yaw rate per radian of error."""
    yaw_rate_radps: float = Field(default=1.0, gt=0, le=5)
    """Highest yaw rate that is asked for."""
    tolerance_rad: float = Field(default=0.035, gt=0, le=0.2)
    """Error at which the nominal angle is reached."""
    search_rad: float = Field(default=0.96, ge=0, le=1.2)
    """How far around the nominal angle the next road may lie."""
    settle_s: float = Field(default=0.7, ge=0)
    """Wait at the nominal angle for a road before searching."""
    sweep_radps: float = Field(default=0.5, gt=0, le=2)
    """Speed of the search in place."""
    sweep_step_rad: float = Field(default=0.12, gt=0, le=0.5)
    """A road seen in frames that disagree by more is no evidence yet."""
    frames: int = Field(default=3, ge=1, le=50)
    """Frames that must agree on the next road, two more for each that did not see it."""
    aligned_rad: float = Field(default=0.21, gt=0, le=0.6)
    """Heading error against the next road at which the follower takes over."""
    settled_radps: float = Field(default=0.35, gt=0, le=5)
    """Yaw rate above which it does not yet, in place: the robot would swing past the road."""
    timeout_s: float = Field(default=20.0, gt=0)
    """Time after which a turn without a road in sight holds."""
    radius_m: float = Field(default=3.0, gt=0)
    """Radius of an arc, where the vehicle needs one and its own minimum is smaller."""
    speed_mps: float = Field(default=1.5, gt=0)
    """Forward speed on an arc."""
    half_width_m: float = Field(default=0.4, ge=0, le=5)
    """Half the width, with a margin, of a vehicle that drives arcs: so much room it keeps."""
    lost_s: float = Field(default=1.0, gt=0)
    """Time without a road in sight, behind a turn, after which it is searched anew."""
    searches: int = Field(default=2, ge=0, le=10)
    """How often it is searched anew; then the robot holds."""
    align_m: float = Field(default=5.0, gt=0)
    """How far a vehicle that cannot turn in place drives on after its arc without seeing a road."""


class NavigatorConfig(BaseModel):
    """What the navigator can be told, apart from the mission."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    camera: CameraGeometry = CameraGeometry()
    """Where the camera is: it says at which distances the score rises and falls."""
    detector: DetectorConfig = DetectorConfig()
    """Smoothing, thresholds and the rules of counting."""
    turn: TurnConfig = TurnConfig()
    """How turns are made."""
    road_source: Name = "road_following"
    """The one follower that is obeyed."""
    cruise_mps: float = Field(default=3.0, gt=0, le=20)
    """Highest forward speed."""
    approach_mps: float = Field(default=2.0, gt=0, le=20)
    """Highest forward speed close to a junction where a turn is planned."""
    approach_m: float = Field(default=8.0, ge=0, le=100)
    """How close: distance before the turn begins."""
    deceleration_mps2: float = Field(default=1.5, gt=0, le=10)
    """With which the robot brakes before it turns in place."""
    velocity_lag_s: float = Field(default=0.35, ge=0, le=3)
    """Delay between a commanded and a reached speed."""
    confidence: float = Field(default=0.3, ge=0, le=1)
    """Least confidence with which a follower is obeyed."""
    sight_confidence: float = Field(default=0.5, ge=0, le=1)
    """Least confidence with which a follower is believed that the next road is in sight."""
    picture_age_s: float = Field(default=0.2, gt=0, le=5)
    """Oldest picture that may move the robot."""
    vehicle_silence_s: float = Field(default=0.5, gt=0, le=10)
    """Longest silence of the vehicle before the robot holds."""
    crossing_width_m: float = Field(default=6.0, gt=0, le=50)
    """Width of a crossing road, unless the follower measures the width of its own."""
    corner_m: float = Field(default=3.0, ge=0, le=30)
    """Length by which the corners' radius widens a junction: the mouth lies this much before it."""
    hold_before_m: float = Field(default=2.0, ge=0)
    """Distance before the mouth over which the held heading replaces the follower's steering."""
    axis_before_m: float = Field(default=5.0, ge=0)
    """Distance before the mouth of a junction to be crossed straight on from which on the road's
    direction is no more learned: the follower may be drawn to a side arm."""
    blind_before_m: float = Field(default=6.0, ge=0)
    """Distance before the mouth within which the robot goes on its held heading when the follower
    is not sure of a road: before a T there is none ahead."""
    exit_margin_m: float = Field(default=3.0, ge=0)
    """Distance behind a junction at which it has been left; behind a mission's last one, twice."""
    end_before_m: float = Field(default=4.0, ge=0)
    """Distance before the end of the robot's road at which it looks around for the way on."""
    blind_m: float = Field(default=0.5, gt=0)
    """How much farther than that the robot goes on its held heading without seeing a road; then it
    looks around for one as after a turn."""
