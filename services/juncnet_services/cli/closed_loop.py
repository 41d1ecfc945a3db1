"""A whole flight in simulated time and one process: the cores of all services, the simulation.

It is deterministic, and with small pictures faster than real time, so tests, tuning and `juncnet
check-follower` use it; what only processes can show (kills, lost messages, a busy machine) is shown
by the flights over Zenoh.
"""

import random
from collections import deque
from dataclasses import dataclass

import numpy as np

from juncnet.assets import asset_path
from juncnet.clocks import NS_PER_S, Instant
from juncnet.features import Extractor
from juncnet.frames import Frame, FrameLayout
from juncnet.layout import load_layout
from juncnet.learning.synthetic import target
from juncnet.messages import (
    JunctionEvent,
    JunctionScore,
    Mission,
    Output,
    PixelFormat,
    Pose,
    RoadCommand,
    SimulatorTruth,
    Stamp,
    VehicleState,
    Velocity,
    VelocityCommand,
)
from juncnet.simulation.dynamics import Motion
from juncnet.simulation.render import Renderer
from juncnet.simulation.truth import GroundTruth
from juncnet.simulation.world import wrap
from juncnet_services.cli.demo import Setup, mission_toml
from juncnet_services.cli.judge import Judge, Summary
from juncnet_services.command_output.limits import Limiter
from juncnet_services.command_output.service import Config as OutputConfig
from juncnet_services.command_output.vehicles import usual_capabilities
from juncnet_services.command_output.vehicles.simulated import SimulatedOptions
from juncnet_services.junction_inference.model import Model
from juncnet_services.junction_inference.service import Config as InferenceConfig
from juncnet_services.junction_navigation.navigator import Navigator
from juncnet_services.junction_navigation.service import Config as NavigationConfig
from juncnet_services.road_following.follower import load_follower
from juncnet_services.road_following.runner import FollowerRunner, Watchdog
from juncnet_services.road_following.service import Config as FollowingConfig
from juncnet_services.simulator.observer import Observer
from juncnet_services.simulator.setup import (
    Config as SimulatorConfig,
)
from juncnet_services.simulator.setup import make_camera, make_vehicle, make_world, starting_motion

CLOCK = "simulated"
SMALL = ("simulator.width=640", "simulator.height=360")
"""Settings for pictures that are rendered fast."""
LATE = (0.1, 0.75, 0.1, 0.05)
"""How often a command follows its picture by 0, 1, 2 or 3 pictures (of 40 ms), where that is drawn;
elsewhere it is 1, about what the pipeline takes."""


@dataclass
class Trace:
    """What happened, picture by picture, for plots and for those who tune."""

    truth: list[SimulatorTruth]
    scores: list[JunctionScore]
    roads: list[RoadCommand]
    events: list[JunctionEvent]
    phases: list[str]
    errors: list[str]


class ClosedLoop:
    """A flight of `setup`."""

    def __init__(
        self,
        setup: Setup,
        fps: float = 25.0,
        oracle: bool = False,
        lateness: random.Random | None = None,
    ):
        """`oracle`: scores come from the truth, to see what the rest does by itself.

        `lateness`: draws how late every command is; None: all are equally late.
        """
        mission = f"junction_navigation.mission={mission_toml(setup.route.mission)}"
        path = asset_path(setup.layout, "layouts", ".toml")
        layout = load_layout(path, (mission, *setup.settings))
        simulator = layout.section("simulator", SimulatorConfig)
        following = layout.section("road_following", FollowingConfig)
        navigation = layout.section("junction_navigation", NavigationConfig)
        output = layout.section("command_output", OutputConfig)
        inference = layout.section("junction_inference", InferenceConfig)
        self.setup, self.step_ns = setup, round(NS_PER_S / fps)
        self.world, camera = make_world(simulator), make_camera(simulator)
        width, height = simulator.width, simulator.height
        self.renderer = Renderer(self.world, width, height, camera, simulator.noise, simulator.seed)
        self.layout = FrameLayout.packed(PixelFormat.I420, width, height)
        self.vehicle = make_vehicle(simulator)
        self.motion: Motion = starting_motion(simulator, self.world, camera)
        self.oracle, self.camera = oracle, camera
        self.observer = Observer(self.world, camera)
        self.ground_truth = GroundTruth(self.world)
        self.model = Model(asset_path(inference.model, "models", ".onnx"))
        self.extractor = Extractor(self.model.preprocessing)
        self.trace = Trace([], [], [], [], [], [])
        self.runner = FollowerRunner(
            load_follower(following.follower, following.options, following.camera),
            following.source,
            Watchdog(60.0, following.follower),
            self.trace.errors.append,
        )
        mission_set = Mission.model_validate(setup.route.mission)
        self.navigator = Navigator(navigation, mission_set, "flight")
        options = SimulatedOptions.model_validate(output.options)
        self.capabilities = usual_capabilities(options.kind, telemetry=options.telemetry)
        self.limiter = Limiter(output.limits, self.capabilities)
        self.judge = Judge(setup.plan, setup.world.name, setup.vehicle)
        self.now_ns, self.sequence = NS_PER_S, 0
        self._lateness, self._late = lateness, 1
        self._commands = deque([Velocity()] * len(LATE), maxlen=len(LATE))

    def _stamp(self) -> Stamp:
        return Stamp(epoch=1, sequence=self.sequence, time_ns=self.now_ns, clock=CLOCK)

    def _state(self) -> VehicleState:
        m, told = self.motion, self.capabilities.telemetry
        measured = Velocity(
            forward_mps=m.forward_mps, lateral_mps=m.lateral_mps, yaw_rate_radps=m.yaw_rate_radps
        )
        return VehicleState(
            at=self._stamp(),
            capabilities=self.capabilities,
            yaw_rad=wrap(m.yaw_rad) if told else None,
            velocity=measured if told else None,
            pose=Pose(x_m=m.x_m, y_m=m.y_m, z_m=m.z_m, yaw_rad=wrap(m.yaw_rad)) if told else None,
            output=Output.PIPELINE,
            commanded=self.limiter.velocity,
        )

    def _score(self, header: Stamp, frame: Frame) -> JunctionScore:
        (score,) = self.model.scores([header], [self.extractor(frame.luminance())])
        return score

    def _oracle(self, header: Stamp) -> JunctionScore:
        m = self.motion
        ahead = self.ground_truth.mouth_ahead(m.x_m, m.y_m, wrap(m.yaw_rad))
        mouth = np.array([np.inf if ahead is None else ahead[0]])
        p = float(target(mouth, self.camera)[0])
        names = {"none": 1 - p, "junction": p}
        return JunctionScore(header=header, model=self.model.identity, probabilities=names)

    def step(self) -> None:
        """Fly on by one picture."""
        self.sequence += 1
        header, m, state = self._stamp(), self.motion, self._state()
        pixels = self.renderer.render_i420(
            m.x_m, m.y_m, m.yaw_rad, roll_rad=m.roll_rad, pitch_rad=m.pitch_rad
        )
        frame = Frame(header, self.layout, pixels)
        score = self._oracle(header) if self.oracle else self._score(header, frame)
        road = self.runner.command(frame, state)
        decision = self.navigator.step(Instant(self.now_ns, CLOCK), score, road, state)
        for event in decision.events:
            self.judge.event(event)
            self.trace.events.append(event)
            self.runner.heard(event)
        self.trace.errors += decision.refused
        wanted = self.command_at_vehicle(decision.velocity or Velocity())
        truth = self.observer.truth(m, header, header, self.now_ns / 1e9 - 1, 1.0)
        self.judge.truth(truth)
        self.judge.score(score)
        command = VelocityCommand(header=header, issued=header, velocity=wanted)
        self.judge.command(command)
        self.trace.truth.append(truth)
        self.trace.scores.append(score)
        self.trace.roads.append(road)
        self.trace.phases.append(decision.state.phase.value)
        brake = wanted == Velocity()
        setpoint = self.limiter.step(wanted, brake, Instant(self.now_ns, CLOCK))
        for _ in range(4):
            self.motion = self.vehicle.step(
                self.motion, setpoint, self.step_ns / NS_PER_S / 4, brake=brake
            )
        self.now_ns += self.step_ns

    def command_at_vehicle(self, newest: Velocity) -> Velocity:
        """Send a command, and return the one that the vehicle has by now: never an older one."""
        self._commands.append(newest)
        if self._lateness is not None:
            drawn = self._lateness.choices(range(len(LATE)), LATE)[0]
            self._late = min(drawn, self._late + 1)
        return self._commands[-1 - self._late]

    def fly(self, patience: float = 2.0, after_s: float = 1.0) -> Summary:
        """Fly to the end of the mission, or until `patience` times the ideal time is over."""
        deadline_ns = self.now_ns + round((5 + patience * self.setup.plan.ideal_s) * NS_PER_S)
        while self.now_ns < deadline_ns:
            self.step()
            if self.judge.finished:
                deadline_ns = min(deadline_ns, self.now_ns + round(after_s * NS_PER_S))
        return self.judge.summary()
