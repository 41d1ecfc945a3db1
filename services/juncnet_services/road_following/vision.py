"""The built-in follower: road mask, seen from above, its centre line, steering."""

import math
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from juncnet.assets import asset_path
from juncnet.camera import CameraGeometry
from juncnet.clocks import NS_PER_S
from juncnet.frames import Frame
from juncnet.messages import RoadSeen, RoadSurface, Stamp, VehicleState
from juncnet.small_picture import shrink
from juncnet_services.road_following.centre_line import (
    INWARD_M,
    KNOWN_WIDTH_SIGMA_M,
    PRIOR_SIGMA,
    CentreLine,
    find,
    fit,
)
from juncnet_services.road_following.follower import Proposal
from juncnet_services.road_following.ground_view import GroundView, RoadEdges
from juncnet_services.road_following.masks import ColourMask, NetworkMask, RoadMask
from juncnet_services.road_following.openings import openings, road_end_m
from juncnet_services.road_following.steering import SteeringOptions, steer
from juncnet_services.road_following.surface import SurfaceMemory

LOST_SUPPORT = 0.12
"""Below this support a picture does not show the road that is followed."""
LOST_FRAMES = 12
"""After so many of them in a row the road is looked for anew."""
KNOWN_FRAMES = 15
"""After so many frames on a road its width is known."""
OPENING_VIEW, OPENING_ROWS = 1.35, 48
"""How far ahead openings of the road's edges are looked for, as a part of the view that the line is
fitted to (farther ahead it is a guess), and how finely."""
AHEAD = 0.3
"""Half the width of what lies straight ahead, in half-widths of the road."""
LONGEST_STEP_S = 0.5
"""Between two pictures, for which the robot's last velocity is believed."""
WRONG_M, WRONG_SHARE = 1.0, 0.6
"""Where most of the nearest edges lie this far outside, the line is not the road's."""


class VisionOptions(BaseModel):
    """Options of the built-in follower."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    camera: CameraGeometry = CameraGeometry()
    """Where the camera sits and how it looks; the aspect is taken from the pictures."""
    mask: str = "road-mask"
    """The road mask model: a path or a shipped one's name; `colour`: by colour, no model."""
    steering: SteeringOptions = SteeringOptions()
    width_m: float = Field(default=6.0, gt=1, le=60)
    """Usual width of a road, where the picture does not show it."""
    view_heights: float = Field(default=5.0, gt=1, le=20)
    """How far ahead the road is looked at, in camera heights."""
    view_m: float = Field(default=14.0, gt=2, le=200)
    """The same in metres; the nearer one counts."""
    unseen: Literal["hold", "go_on"] = "hold"
    """Without road ahead: propose nothing, or go on slowly along the road that was."""


class VisionFollower:
    """Follows the middle of the road that the robot is on."""

    Options = VisionOptions

    def __init__(self, options: VisionOptions) -> None:
        self._options = options
        self._mask: RoadMask = (
            ColourMask()
            if options.mask == "colour"
            else NetworkMask(asset_path(options.mask, "models", ".onnx"))
        )
        self._view: GroundView | None = None
        self._far_view: GroundView | None = None
        self._camera = options.camera
        """With the pictures' aspect, once there was one."""
        self._line: CentreLine | None = None
        self._poor_frames = self._frames = 0
        self._speed_mps = self._yaw_rate_radps = 0.0
        self._header: Stamp | None = None
        self._surface: SurfaceMemory | None = None

    @property
    def line(self) -> CentreLine | None:
        """The centre line in the newest picture, None before the first and after a reset."""
        return self._line

    def reset(self, reason: str) -> None:
        """Forget the road: the next picture shows another one."""
        del reason
        self._line, self._poor_frames, self._frames = None, 0, 0

    def follow(self, frame: Frame, state: VehicleState | None) -> Proposal | None:
        """Return the velocity along the road in `frame`; None: it shows no road."""
        probability = self._mask.probability(shrink(frame))
        view = self._view_of(frame, probability.shape)
        above = view.from_above(probability)
        self._predict(frame.header, state)
        surface = self._surface_around(probability, state)
        line, edges = self._fitted(view, above)
        confidence = self._confidence(line, edges)
        poor = line.support < LOST_SUPPORT or _elsewhere(line, edges)
        self._poor_frames = self._poor_frames + 1 if poor else 0
        self._line = line if self._poor_frames < LOST_FRAMES else None
        self._frames = self._frames + 1 if self._line is not None else 0
        if confidence < 0.05 and self._options.unseen == "hold":
            self._speed_mps = self._yaw_rate_radps = 0.0
            return None if surface is None else Proposal(None, 0.0, surface=surface)
        velocity = steer(
            line, confidence, self._speed_mps, self._yaw_rate_radps, self._options.steering
        )
        if state is None or state.velocity is None:
            self._speed_mps, self._yaw_rate_radps = (
                velocity.forward_mps,
                velocity.yaw_rate_radps,
            )
        return Proposal(velocity, confidence, self._seen(line, view, above, probability), surface)

    def _view_of(self, frame: Frame, shape: tuple[int, ...]) -> GroundView:
        """Return the ground view for pictures of this shape, kept from picture to picture."""
        aspect = frame.width / frame.height
        if self._view is None or aspect != self._camera.aspect:
            self._camera = camera = self._options.camera.model_copy(update={"aspect": aspect})
            far_m = min(self._options.view_heights * camera.height_m, self._options.view_m)
            self._view = GroundView(camera, (shape[0], shape[1]), far_m)
            farther_m = OPENING_VIEW * far_m
            self._far_view = GroundView(camera, (shape[0], shape[1]), farther_m, rows=OPENING_ROWS)
            self._surface = None
        return self._view

    def _predict(self, header: Stamp, state: VehicleState | None) -> None:
        """Move the line by what the robot drove since the last picture."""
        if state is not None and state.velocity is not None:
            self._speed_mps = state.velocity.forward_mps
            self._yaw_rate_radps = state.velocity.yaw_rate_radps
        last, self._header = self._header, header
        if last is None or last.epoch != header.epoch:
            self._surface = None
            return
        passed_s = max((header.time_ns - last.time_ns) / NS_PER_S, 0.0)
        if passed_s > LONGEST_STEP_S:  # where the robot went meanwhile, nobody knows
            passed_s, self._surface = LONGEST_STEP_S, None
        ahead_m, turned_rad = self._speed_mps * passed_s, self._yaw_rate_radps * passed_s
        if self._line is not None:
            self._line = self._line.moved(ahead_m, turned_rad)
        if self._surface is not None:
            self._surface.move(ahead_m, turned_rad)

    def _surface_around(
        self, probability: NDArray[np.float32], state: VehicleState | None
    ) -> RoadSurface | None:
        """Return the road's surface around a vehicle that tells how it moves."""
        if state is None or state.velocity is None:
            self._surface = None
            return None
        if self._surface is None:
            self._surface = SurfaceMemory(self._camera)
        self._surface.see(probability)
        return self._surface.around()

    def _fitted(self, view: GroundView, above: NDArray[np.float32]) -> tuple[CentreLine, RoadEdges]:
        """Return the line in this picture, and the edges beside it."""
        start = self._line or find(view, above, self._options.width_m)
        edges = view.edges(above, start.y(view.x_m), 0.75 * start.half_width_m)
        sigma = PRIOR_SIGMA.copy()
        if self._frames > KNOWN_FRAMES:
            sigma[4] = KNOWN_WIDTH_SIGMA_M
        line = fit(edges, start, sigma)
        return line, view.edges(above, line.y(view.x_m), 0.75 * line.half_width_m)

    def _seen(
        self,
        line: CentreLine,
        view: GroundView,
        above: NDArray[np.float32],
        probability: NDArray[np.float32],
    ) -> RoadSeen:
        """Return the line as the message has it, with twelve points of its centre.

        Other roads' mouths and the road's end are looked for once the road's width is known.
        """
        x = np.linspace(view.near_m, view.far_m, 12)
        points = zip(x, np.clip(line.y(x), -100, 100), strict=True)
        mouths, ends_m = (), None
        if self._far_view is not None and self._frames > KNOWN_FRAMES:
            far, half_m = self._far_view.from_above(probability), AHEAD * line.half_width_m
            mouths = openings(self._far_view, far, line)
            ends_m = road_end_m(view, above, half_m)
            if ends_m is None:  # beyond the near view, but farther ahead it is less sure
                ends_m = road_end_m(self._far_view, far, half_m)
        return RoadSeen(
            offset_m=line.offset_m,
            heading_rad=math.atan(line.heading),
            width_m=2 * line.half_width_m,
            curvature_1pm=line.curvature_1pm,
            centre=tuple((float(px), float(py)) for px, py in points),
            openings=mouths,
            ends_m=ends_m,
        )

    def _confidence(self, line: CentreLine, edges: RoadEdges) -> float:
        """Return 0..1: how much of the line is on the road, and how well its edges are seen."""
        visible = int(edges.visible.sum())
        if visible == 0:
            return 0.0
        on_road = float(edges.on_road.sum()) / visible
        return min(1.0, on_road * (0.35 + line.support))


def _elsewhere(line: CentreLine, edges: RoadEdges) -> bool:
    """Return whether most of the nearest edges, left or right, are not the line's own.

    They lie well outside, or so far inside that the fit leaves them out: the road has become
    narrower, as behind a junction.
    """
    near = slice(0, edges.x_m.size // 3)
    middle = line.y(edges.x_m[near])
    half = line.half_width_m * np.hypot(1.0, line.slope(edges.x_m[near]))
    left = edges.left_m[near] - middle - half
    right = middle - half - edges.right_m[near]
    wrong_left = ((left > WRONG_M) | (left < -INWARD_M)) & ~edges.left_open[near]
    wrong_right = ((right > WRONG_M) | (right < -INWARD_M)) & ~edges.right_open[near]
    return bool(wrong_left.mean() > WRONG_SHARE or wrong_right.mean() > WRONG_SHARE)
