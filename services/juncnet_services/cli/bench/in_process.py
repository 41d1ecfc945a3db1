"""The pipeline in one process: the stages of the six services called in turn, with no bus.

What the real processes are held against: the same cores, the same configuration, the same pictures.
"""

import time
from collections.abc import Callable
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from juncnet.assets import asset_path
from juncnet.clocks import NS_PER_S, Instant
from juncnet.features import Extractor
from juncnet.flight import HostClock
from juncnet.frames import Frame, FrameLayout
from juncnet.layout import Layout
from juncnet.messages import (
    Capabilities,
    Mission,
    Output,
    PixelFormat,
    Stamp,
    VehicleState,
    Velocity,
    VelocityCommand,
)
from juncnet.simulation.render import Renderer
from juncnet_services.command_output.arbiter import Arbiter
from juncnet_services.command_output.limits import Limiter
from juncnet_services.command_output.service import Config as OutputConfig
from juncnet_services.junction_inference.model import Model
from juncnet_services.junction_inference.service import Config as InferenceConfig
from juncnet_services.junction_navigation.navigator import Navigator
from juncnet_services.junction_navigation.service import Config as NavigationConfig
from juncnet_services.road_following.follower import load_follower
from juncnet_services.road_following.runner import FollowerRunner, Watchdog
from juncnet_services.road_following.service import Config as FollowingConfig
from juncnet_services.simulator.setup import (
    Config as SimulatorConfig,
)
from juncnet_services.simulator.setup import make_camera, make_world, starting_motion

COPTER = Capabilities(
    kind="copter", lateral=True, vertical=True, turns_in_place=True, telemetry=True
)
ADVANCE_M = 0.12
"""Between two pictures: a copter at 3 m/s and 25 FPS."""
Picture = NDArray[np.uint8]
R = TypeVar("R")


def pictures(layout: Layout, count: int) -> tuple[FrameLayout, list[Picture]]:
    """Return `count` pictures as the layout's simulated camera takes them on its first metres.

    Returns:
        Their layout, I420, and each as a flat uint8 array.
    """
    config = layout.section("simulator", SimulatorConfig)
    world, camera = make_world(config), make_camera(config)
    start = starting_motion(config, world, camera)
    renderer = Renderer(world, config.width, config.height, camera, config.noise, config.seed)
    frames = FrameLayout.packed(PixelFormat.I420, config.width, config.height)
    taken: list[Picture] = []
    for index in range(count):
        pixels = np.empty(frames.nbytes, np.uint8)
        x_m = start.x_m + index * ADVANCE_M * float(np.cos(start.yaw_rad))
        y_m = start.y_m + index * ADVANCE_M * float(np.sin(start.yaw_rad))
        renderer.render_i420(x_m, y_m, start.yaw_rad, 0.0, 0.0, 0.0, out=pixels)
        taken.append(pixels)
    return frames, taken


class Pipeline:
    """The cores of the six services as a layout configures them."""

    def __init__(self, layout: Layout) -> None:
        following = layout.section("road_following", FollowingConfig)
        navigation = layout.section("junction_navigation", NavigationConfig)
        output = layout.section("command_output", OutputConfig)
        inference = layout.section("junction_inference", InferenceConfig)
        self._clock, self._sequence = HostClock(), 0
        self._model = Model(asset_path(inference.model, "models", ".onnx"))
        self._extractor = Extractor(self._model.preprocessing)
        self.errors: list[str] = []
        watchdog = Watchdog(60.0, following.follower)
        follower = load_follower(following.follower, following.options)
        self._runner = FollowerRunner(follower, following.source, watchdog, self.errors.append)
        mission = Mission(name="follow")
        self._navigator = Navigator(navigation, mission, "in-process")
        self._arbiter = Arbiter(output)
        self._limiter = Limiter(output.limits, COPTER)
        self._captured: Picture | None = None

    def _stamp(self) -> Stamp:
        self._sequence += 1
        return Stamp(
            epoch=1, sequence=self._sequence, time_ns=self._clock.now_ns(), clock=self._clock.id
        )

    def _now(self) -> Instant:
        return Instant(self._clock.now_ns(), self._clock.id)

    def step(self, layout: FrameLayout, pixels: Picture) -> dict[str, float]:
        """Take a picture through all stages, and return the ms that each of them took."""
        times_ms: dict[str, float] = {}
        header = self._stamp()
        frame = timed(times_ms, "frame_capture", lambda: self._capture(header, layout, pixels))
        features = timed(
            times_ms, "radon_preprocessing", lambda: self._extractor(frame.luminance())
        )
        (score,) = timed(
            times_ms, "junction_inference", lambda: self._model.scores([header], [features])
        )
        vehicle = VehicleState(
            at=self._stamp(),
            capabilities=COPTER,
            yaw_rad=0.0,
            velocity=self._limiter.velocity,
            output=Output.PIPELINE,
            commanded=self._limiter.velocity,
        )
        road = timed(times_ms, "road_following", lambda: self._runner.command(frame, vehicle))
        decision = timed(
            times_ms,
            "junction_navigation",
            lambda: self._navigator.step(self._now(), score, road, vehicle),
        )
        command = VelocityCommand(header=header, issued=self._stamp(), velocity=decision.velocity)
        timed(times_ms, "command_output", lambda: self._output(command))
        return times_ms

    def _capture(self, header: Stamp, layout: FrameLayout, pixels: Picture) -> Frame:
        if self._captured is None or self._captured.size != pixels.size:
            self._captured = np.empty_like(pixels)
        np.copyto(self._captured, pixels)
        return Frame(header, layout, self._captured)

    def _output(self, command: VelocityCommand) -> Velocity:
        now = self._now()
        refused = self._arbiter.command(command, now)
        if refused is not None:
            self.errors.append(refused)
        decision = self._arbiter.step(now)
        return self._limiter.step(decision.velocity, not decision.moving, now)


def timed(times_ms: dict[str, float], name: str, stage: Callable[[], R]) -> R:
    """Return what `stage` returns; `times_ms[name]` is the ms that it took."""
    started_ns = time.perf_counter_ns()
    result = stage()
    times_ms[name] = (time.perf_counter_ns() - started_ns) / (NS_PER_S / 1e3)
    return result
