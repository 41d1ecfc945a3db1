"""The simulated drone's camera: renders straight into the memory that the picture is sent in."""

from juncnet.bus import Bus
from juncnet.clocks import Clock
from juncnet.frames import FrameLayout
from juncnet.messages import PixelFormat, Stamp
from juncnet.simulation.dynamics import Motion
from juncnet.simulation.render import Renderer
from juncnet.simulation.world import World
from juncnet.topics import SIMULATOR_CAMERA
from juncnet_services.simulator.setup import Config, make_camera, make_video, starting_motion


class Camera:
    """A camera on the vehicle; its pictures are numbered without gaps."""

    def __init__(self, bus: Bus, config: Config, world: World) -> None:
        geometry = make_camera(config)
        self._epoch, self._clock, self._sequence = bus.epoch, bus.clock, 0
        self._ground_m = starting_motion(config, world, geometry).z_m
        self._layout = FrameLayout.packed(PixelFormat.I420, config.width, config.height)
        self._frames = bus.frames_out(SIMULATOR_CAMERA)
        self._video = make_video(config)
        self._renderer = Renderer(
            world, config.width, config.height, geometry, config.noise, config.seed
        )

    def stamp(self) -> Stamp:
        """Return the stamp of a picture that is taken now."""
        self._sequence += 1
        clock: Clock = self._clock
        return Stamp(
            epoch=self._epoch, sequence=self._sequence, time_ns=clock.now_ns(), clock=clock.id
        )

    def take(self, motion: Motion, header: Stamp) -> None:
        """Render what is seen from `motion` and send it under `header`."""
        loan = self._frames.loan(self._layout)
        self._renderer.render_i420(
            motion.x_m,
            motion.y_m,
            motion.yaw_rad,
            motion.z_m - self._ground_m,
            motion.roll_rad,
            motion.pitch_rad,
            out=loan.pixels,
        )
        if self._video is not None:
            self._video.offer(loan.pixels)
        loan.send(header)

    def close(self) -> None:
        """End the stream."""
        if self._video is not None:
            self._video.close()
