"""The navigator: which junction, where to turn, what to do now. Pure: time is an argument."""

import math
from collections.abc import Mapping

from juncnet.clocks import Instant, Offset
from juncnet.messages import (
    EventKind,
    JunctionScore,
    Mission,
    Phase,
    Reply,
    RoadCommand,
    VehicleState,
    Velocity,
)
from juncnet_services.junction_navigation import turning
from juncnet_services.junction_navigation.axis import RoadAxis
from juncnet_services.junction_navigation.config import NavigatorConfig
from juncnet_services.junction_navigation.decision import Decision
from juncnet_services.junction_navigation.detector import JunctionDetector
from juncnet_services.junction_navigation.helm import Helm
from juncnet_services.junction_navigation.inputs import Inputs
from juncnet_services.junction_navigation.odometry import Odometry
from juncnet_services.junction_navigation.plan import JunctionPlan
from juncnet_services.junction_navigation.progress import Progress, TurnProgress
from juncnet_services.junction_navigation.report import EventLog, state_of
from juncnet_services.junction_navigation.road_sight import RoadSight
from juncnet_services.junction_navigation.sightings import Sightings
from juncnet_services.junction_navigation.speed import (
    NO_MOTION,
    blended,
    feasible,
    scaled,
)
from juncnet_services.junction_navigation.store import FRESH, Resumed
from juncnet_services.junction_navigation.way_on import nothing_ahead, sees_way_on

STANDING_MPS = 0.35
ARM_M = 3.0
"""How much farther towards an arm that is seen than without one a junction is crossed without the
follower seeing a road."""


class Navigator:
    """Follows a mission by junction scores and a follower's road commands.

    `found` is what a restart found: the progress to go on with, and why the robot must hold until
    a mission is set, if it must. Its note stands in the state up to the first motion.
    """

    def __init__(
        self,
        config: NavigatorConfig,
        mission: Mission,
        flight: str,
        found: Resumed = FRESH,
        offsets: Mapping[str, Offset] | None = None,
    ) -> None:
        saved = found.progress
        self.config = config
        self.progress = saved or Progress(flight=flight, configured=mission, mission=mission)
        self._blocked = found.blocked
        self._note = found.note
        self._inputs = Inputs(config, offsets)
        self._odometry = Odometry(config, self.progress, saved is not None)
        self._detector = JunctionDetector(config.detector, config.camera.band, self.progress)
        self._sightings = Sightings(config.camera, self.progress)
        self._plan = JunctionPlan(config, self.progress)
        self._axis = RoadAxis(config, self.progress, self._plan, self._inputs)
        self._helm = Helm(config, self.progress, self._plan, self._inputs)
        self._sight = RoadSight(config)
        self._elapsed_s = 0.0
        self._astray = False
        """Whether the follower's road, behind a turn, is another one than that was made into."""
        self._events = EventLog(self.progress, saved is not None)
        self._reason = ""

    def step(
        self,
        now: Instant,
        score: JunctionScore | None = None,
        road: RoadCommand | None = None,
        vehicle: VehicleState | None = None,
    ) -> Decision:
        """Take what is new (None: nothing) and return what to do at `now`."""
        if vehicle is not None:
            self._inputs.accept_vehicle(now, vehicle)
            self._plan.capabilities = vehicle.capabilities
        live = self._inputs.live_vehicle(now)
        self._elapsed_s = 0.0 if live is None else self._odometry.advance(now.ns, live)
        if score is not None:
            self._take_score(now, score)
        if road is not None:
            self._take_road(now, road)
        self._reason = self._blocked or self._inputs.why_hold(now)
        wanted = NO_MOTION if self._reason else self._drive()
        self._tell_note(wanted)
        velocity = feasible(wanted, self._plan.capabilities, self.config.turn.yaw_rate_radps)
        return self._decision(velocity)

    def set_mission(self, mission: Mission) -> Reply:
        """Begin `mission` with a count of 0, unless the robot is at a junction."""
        phase = self.progress.phase
        if phase not in (Phase.WAITING, Phase.FOLLOWING, Phase.FINISHED):
            return Reply(
                accepted=False,
                reason=f"the robot is {phase} at junction {self.progress.count}: "
                "hold it or wait until the junction is left, then ask again",
            )
        previous = self.progress.count
        self.progress.mission, self.progress.count = mission, 0
        if self.progress.junction is not None:
            self._pass_junction()
        self.progress.phase = Phase.WAITING
        self._blocked = self._note = ""
        return Reply(accepted=True, reason=f"the count starts at 0 (it was {previous})")

    def _take_score(self, now: Instant, score: JunctionScore) -> None:
        if not self._inputs.accept_score(now, score):
            return
        header = score.header
        time_ns = self._inputs.captured_ns(header, now)
        edge = self._detector.smooth(header.time_ns, score.junction)
        if edge is True:
            lag_ns = round(self._detector.rise_lag_s * 1e9)
            self._detector.risen(self._odometry.at(time_ns - lag_ns)[0], score.label)
        elif edge is False:
            lag_ns = round(self._detector.fall_lag_s * 1e9)
            self._detector.fallen(self._odometry.at(time_ns - lag_ns)[0])
        self._detector.watch(score.label)
        self._sightings.weigh()

    def _take_road(self, now: Instant, road: RoadCommand) -> None:
        previous = self._inputs.road
        if not self._inputs.accept_road(now, road):
            return
        header = road.header
        at_m, yaw = self._odometry.at(self._inputs.captured_ns(header, now))
        if road.road is not None and self.progress.turn is None:
            aside_rad = yaw - self.progress.heading_rad
            trusted = self._inputs.road_trust >= 1
            self._sightings.see(road.road, at_m, trusted, aside_rad, road.surface)
        if self.progress.turn is not None:
            self._sight.see(road, yaw, self.progress.turn)
            return
        if self.progress.phase is Phase.CROSSING and self._plan.straight:
            self._sight.see_ahead(road, yaw, self._plan.turn, self._plan.axis_rad)
        if self.progress.turned is not None:
            turned = self.progress.turned
            self._astray = turning.is_astray(road, at_m, yaw, turned, self.config.turn)
        if previous is not None and self._inputs.road_visible:
            self._axis.see(road, yaw, (header.time_ns - previous.header.time_ns) / 1e9)

    def _drive(self) -> Velocity:
        if self.progress.phase is Phase.WAITING:
            self.progress.phase = Phase.FOLLOWING
        steps = {
            Phase.FOLLOWING: self._following,
            Phase.APPROACHING: self._approaching,
            Phase.CROSSING: self._crossing,
            Phase.TURNING: self._turning,
            Phase.ALIGNING: self._aligning,
            Phase.FINISHED: self._finished,
        }
        return steps[self.progress.phase]()

    def _following(self) -> Velocity:
        state = self.progress
        if state.leave_m is not None and state.odometer_m >= state.leave_m:
            self._leave()
            if state.phase is Phase.FINISHED:
                return self._finished()
        if self._lost_after_turn():
            if state.turned and state.turned.searched_anew >= self.config.turn.searches:
                return self._wait("the road of the turn was lost again and again")
            self._search_anew()
            return self._aligning()
        found = self._detector.next_junction()
        if found is None and state.leave_m is None:
            found = self._sightings.next_junction()
        if found is not None:
            state.junction, state.phase = found, Phase.APPROACHING
            state.count += 1
            self._event(EventKind.APPROACHED)
        limit = self.config.cruise_mps if state.leave_m is None else self.config.approach_mps
        return self._follow(limit)

    def _approaching(self) -> Velocity:
        if self._plan.mouth_ahead_m <= 0 or self._plan.start_ahead_m <= 0:
            self._enter()
            return self._crossing()
        blind = not self._inputs.road_visible
        if blind and self._plan.mouth_ahead_m <= self.config.blind_before_m:
            return self._helm.hold_heading(self._plan.speed_limit_mps)
        steered = self._follow(self._plan.speed_limit_mps)
        held = self._helm.hold_heading(steered.forward_mps)
        if self._reason or self.config.hold_before_m == 0:
            return steered
        near = 1 - self._plan.mouth_ahead_m / self.config.hold_before_m
        share = max(near, 1 - self._inputs.road_trust)
        yaw_rate = blended(steered.yaw_rate_radps, held.yaw_rate_radps, share)
        return steered.model_copy(update={"yaw_rate_radps": yaw_rate})

    def _crossing(self) -> Velocity:
        state = self.progress
        if not self._plan.straight:
            standing = self._plan.radius_m > 0 or abs(state.speed_mps) <= STANDING_MPS
            if standing and (self._plan.start_ahead_m <= 0 or self._helm.last_chance):
                self._begin_turn()
                return self._turning()
            return self._helm.hold_heading(self._plan.speed_limit_mps)
        past_m, arm_rad = self._plan.past_m, self._sight.agreed_rad
        followed = arm_rad is None or self._sight.followed
        if past_m >= 0 and self._inputs.road_visible and followed:
            self._leave()
            return self._drive()
        if arm_rad is not None:
            if past_m < self.config.blind_m + ARM_M:
                return self._cross_towards(arm_rad)
        elif sees_way_on(state, self._inputs, self._plan, self.config):
            return self._take_way_on()
        if past_m >= self.config.blind_m or nothing_ahead(state, self._plan, self.config):
            self._begin_turn()
            return self._turning()
        return self._helm.cross(self.config.cruise_mps)

    def _cross_towards(self, arm_rad: float) -> Velocity:
        """Go on to the arm that a map of the surface shows; by the follower's road, if it is it."""
        behind_middle = self._plan.mouth_ahead_m <= -self._plan.reach_m
        if behind_middle and self._inputs.road_certain and self._sight.followed:
            self.progress.axis_rad = self.progress.yaw_rad
            return self._follow(self.config.approach_mps)
        self.progress.axis_rad = arm_rad
        return self._helm.cross(self.config.cruise_mps)

    def _take_way_on(self) -> Velocity:
        """Go by the follower's road; where the surface ahead ends, its steering is too gentle."""
        state, speed_mps = self.progress, self.config.approach_mps
        if self._plan.ends_here:
            state.axis_rad = self._inputs.road_towards_rad(state.yaw_rad)
            return self._helm.hold_heading(speed_mps)
        state.axis_rad = state.yaw_rad
        return self._follow(speed_mps)

    def _enter(self) -> None:
        state = self.progress
        state.phase = Phase.CROSSING
        self._sight.reset()
        if state.junction is not None:
            state.junction.axis_rad = state.heading_rad
        self._event(EventKind.ENTERED)

    def _begin_turn(self) -> None:
        state = self.progress
        nominal = state.heading_rad + turning.angle_rad(self._plan.turn)
        state.turn = TurnProgress(
            turn=self._plan.turn,
            nominal_rad=nominal,
            radius_m=self._plan.radius_m,
            started_m=state.odometer_m,
        )
        state.phase = Phase.TURNING
        self._sight.reset()
        self._sightings.forget()
        self._event(EventKind.TURN_STARTED)

    def _turning(self) -> Velocity:
        turn, state = self._under_way, self.progress
        if turn.elapsed_s > self.config.turn.timeout_s:
            return self._wait("the turn takes too long: does the vehicle yaw?")
        if turn.arm_rad is not None and not turn.in_place and not self._sight.aligned:
            return self._yaw_towards(turn.arm_rad, turn)
        error = turn.nominal_rad - state.yaw_rad
        held_back = turning.is_held_back(turn, state.odometer_m, state.yaw_rad)
        turn.held_back = turn.held_back or held_back
        middle, within = turning.search_arc(turn.turn, 0.0, self.config.turn, turn.held_back)
        near = turn.arm_rad is not None or abs(error + middle) <= within
        seen = near and self._sight.agreed_rad is not None
        if seen or abs(error) <= self.config.turn.tolerance_rad:
            state.phase = Phase.ALIGNING
            return self._aligning()
        return self._yaw_towards(turn.nominal_rad, turn)

    def _aligning(self) -> Velocity:
        turn, state, config = self._under_way, self.progress, self.config.turn
        swings = turn.in_place and abs(self._odometry.yaw_rate_radps) > config.settled_radps
        if self._sight.aligned and not swings:
            return self._end_turn()
        if self._sight.agreed_rad is not None:
            return self._yaw_towards(self._sight.agreed_rad, turn)
        turn.aligning_s += self._elapsed_s
        if not turn.in_place:
            if turn.aligning_from_m is None:
                turn.aligning_from_m = state.odometer_m
            if state.odometer_m - turn.aligning_from_m > config.align_m:
                return self._wait("no road is seen after the turn")
            return self._yaw_towards(turn.nominal_rad, turn)
        sign = math.copysign(1.0, turning.angle_rad(turn.turn))
        middle, within = turning.search_arc(turn.turn, turn.aligning_s, config)
        if turn.elapsed_s > config.timeout_s:
            return self._wait("no road is seen after the turn")
        offset = middle + turning.sweep_rad(turn.aligning_s, sign, within, config)
        return self._yaw_towards(turn.nominal_rad + offset, turn)

    def _end_turn(self) -> Velocity:
        state = self.progress
        self._event(EventKind.TURN_FINISHED)
        state.axis_rad = self._sight.agreed_rad
        state.leave_m = state.odometer_m + self._plan.reach_m + self._plan.exit_margin_m
        self._detector.forget()
        state.turned = self._under_way.model_copy(update={"ended_m": state.odometer_m})
        state.turn, state.phase = None, Phase.FOLLOWING
        self._astray = False
        return self._following()

    def _lost_after_turn(self) -> bool:
        """Return whether the road of the turn made at this junction is out of sight for good."""
        turned = self.progress.turned
        if turned is None:
            return False
        seen = self._inputs.road_visible and not self._astray
        turned.lost_s = 0.0 if seen else turned.lost_s + self._elapsed_s
        return turned.lost_s > self.config.turn.lost_s

    def _search_anew(self) -> None:
        """Go on with the turn that was taken for finished."""
        state = self.progress
        if state.turned is not None:
            state.turn, state.phase = state.turned.searching_anew, Phase.ALIGNING
        state.turned = state.leave_m = None
        self._sight.reset()
        self._event(EventKind.TURN_STARTED)

    def _leave(self) -> None:
        """The junction is behind: the mission goes on or is finished."""
        state = self.progress
        self._event(EventKind.LEFT)
        self._pass_junction()
        state.phase = Phase.FOLLOWING
        self._sightings.forget(state.left_m)
        if state.at_last_junction:
            state.phase = Phase.FINISHED
            self._event(EventKind.MISSION_FINISHED)

    def _pass_junction(self) -> None:
        state = self.progress
        state.left_m, state.left_turned = state.odometer_m, state.leave_m is not None
        state.leave_m = state.junction = state.turned = None

    def _finished(self) -> Velocity:
        return self._wait("the mission is finished")

    @property
    def _under_way(self) -> TurnProgress:
        turn = self.progress.turn
        if turn is None:
            raise RuntimeError("a turn's phase without a turn")
        return turn

    def _follow(self, limit_mps: float) -> Velocity:
        road = self._inputs.road
        if road is None or road.velocity is None:
            return self._wait("the follower sees no road")
        if not self._inputs.road_visible:
            return self._wait("the follower is not sure of the road")
        if self.progress.turned is not None and self._astray:
            return self._wait("the follower sees another road than that was turned into")
        return scaled(road.velocity, limit_mps)

    def _yaw_towards(self, target: float, turn: TurnProgress) -> Velocity:
        if self._helm.off_road:
            return self._wait("the robot has left the road, and no arc leads back onto it")
        turn.elapsed_s += self._elapsed_s
        return self._helm.yaw_towards(target, turn)

    def _wait(self, reason: str) -> Velocity:
        self._reason = reason
        return NO_MOTION

    def _tell_note(self, wanted: Velocity) -> None:
        """Add what a restart found to the reason, up to the first motion."""
        self._reason = "; ".join(text for text in (self._reason, self._note) if text)
        if wanted != NO_MOTION:
            self._note = ""

    def _decision(self, velocity: Velocity) -> Decision:
        header, events = self._inputs.header, self._events.take()
        refused, self._inputs.refused = tuple(self._inputs.refused), []
        state = state_of(self.progress, header, self._detector.thresholds, self._reason)
        return Decision(header, velocity, state, events, refused)

    def _event(self, kind: EventKind) -> None:
        self._events.add(kind, self._inputs.header, self._plan.turn)
