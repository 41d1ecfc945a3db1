"""What is true of the simulated flight, as the message that tests and reports read."""

from juncnet.camera import CameraGeometry
from juncnet.messages import Pose, SimulatorTruth, Stamp, Velocity
from juncnet.simulation.dynamics import Motion
from juncnet.simulation.truth import GroundTruth, PassCounter
from juncnet.simulation.world import World, wrap


class Observer:
    """Follows the robot through its world: where it is, what it passed, what it hit."""

    def __init__(self, world: World, camera: CameraGeometry) -> None:
        self._truth, self._camera = GroundTruth(world), camera
        self._passes = PassCounter(self._truth)
        self._collided = False

    def truth(
        self,
        motion: Motion,
        at: Stamp,
        header: Stamp | None,
        simulated_s: float,
        real_time_factor: float,
    ) -> SimulatorTruth:
        """Return the truth of `motion`; call it often enough to see every metre of the way."""
        x, y, yaw = motion.x_m, motion.y_m, wrap(motion.yaw_rad)
        self._passes.update(x, y, yaw)
        self._collided = self._collided or self._truth.collides(x, y, motion.z_m)
        mouth = self._truth.mouth_ahead(x, y, yaw)
        return SimulatorTruth(
            at=at,
            header=header,
            pose=Pose(
                x_m=x,
                y_m=y,
                z_m=motion.z_m,
                roll_rad=motion.roll_rad,
                pitch_rad=motion.pitch_rad,
                yaw_rad=yaw,
            ),
            velocity=Velocity(
                forward_mps=motion.forward_mps,
                lateral_mps=motion.lateral_mps,
                vertical_mps=motion.vertical_mps,
                yaw_rate_radps=motion.yaw_rate_radps,
            ),
            road_offset_m=self._truth.road_offset_m(x, y, yaw),
            off_road_m=self._truth.off_road_m(x, y),
            collided=self._collided,
            junction_id=self._truth.junction_of(x, y),
            junctions_passed=self._passes.passed,
            path=self._passes.path,
            label=self._truth.label(x, y, yaw, self._camera),
            mouth_m=mouth[0] if mouth else None,
            real_time_factor=real_time_factor,
            simulated_s=simulated_s,
        )
