"""Configuration of the simulator, and the world, vehicle and camera that it asks for."""

from dataclasses import replace
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from juncnet.camera import CameraGeometry
from juncnet.frames import FrameLayout
from juncnet.messages import PixelFormat
from juncnet.simulation.dynamics import CALM, Copter, Drift, Motion, Rover, Vehicle
from juncnet.simulation.towns import make_style, named_world, random_world
from juncnet.simulation.world import TimeOfDay, World
from juncnet_services.simulator.video import VideoOptions, VideoStream

ROVER_CAMERA = CameraGeometry(height_m=2.2, pitch_rad=0.30)


class Config(BaseModel):
    """Options of the simulator."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    world: str | None = None
    """Name of a world (`juncnet.simulation.towns.WORLD_NAMES`); None: the random one of `seed`."""
    seed: int = Field(default=1, ge=0)
    """Of the random world, of the drift and of the camera's noise."""
    palette: str | None = None
    """Colours other than the world's own: temperate, dry, autumn, nordic, suburb, withheld."""
    time_of_day: TimeOfDay | None = None
    """Light other than the world's own: morning, noon, evening, overcast."""
    vehicle: Literal["copter", "rover"] = "copter"
    camera: CameraGeometry | None = None
    """Where the camera sits, what it sees; None: as usual for the vehicle. Aspect: the size's."""
    width: int = Field(default=1920, ge=16, le=8192, multiple_of=2)
    height: int = Field(default=1080, ge=16, le=8192, multiple_of=2)
    fps: float = Field(default=25.0, gt=0, le=240)
    video: VideoOptions | None = None
    """Also send the camera as H.264 over RTP; None: raw frames on this host only."""
    noise: float = Field(default=2.0, ge=0, le=50)
    """Standard deviation of the sensor's noise, grey levels."""
    speed_error: float = Field(default=1.0, ge=0.5, le=1.5)
    """Real speed as a multiple of the commanded one, which is also what the telemetry believes."""
    drift: bool = True
    """Wind or slip of about 0.1 m/s and a yaw bias of up to 0.5 degrees a second."""
    link_loss_s: float = Field(default=10.0, gt=0, le=3600)
    """How long the last setpoint is flown on when no more come; then it holds."""
    truth_hz: float = Field(default=25.0, ge=5, le=100)

    @model_validator(mode="after")
    def _known_world(self) -> "Config":
        if self.world is not None:
            named_world(self.world)
        return self


def make_world(config: Config) -> World:
    """Return the world that `config` names, in the look that it asks for."""
    world = named_world(config.world) if config.world else random_world(config.seed)
    if config.palette is None and config.time_of_day is None:
        return world
    palette = config.palette or world.style.palette
    time_of_day = config.time_of_day or world.style.time_of_day
    return replace(world, style=make_style(palette, time_of_day, config.seed))


def make_camera(config: Config) -> CameraGeometry:
    """Return the camera of `config`, its aspect that of the picture."""
    usual = CameraGeometry() if config.vehicle == "copter" else ROVER_CAMERA
    camera = config.camera or usual
    return camera.model_copy(update={"aspect": config.width / config.height})


def make_vehicle(config: Config) -> Vehicle:
    """Return the dynamics of the vehicle of `config`."""
    drift = Drift(seed=config.seed) if config.drift else CALM
    if config.vehicle == "copter":
        return Copter(speed_error=config.speed_error, drift=drift)
    return Rover(speed_error=config.speed_error, drift=drift)


def starting_motion(config: Config, world: World, camera: CameraGeometry) -> Motion:
    """Return the motion at the world's start: a copter hovers at its camera's height."""
    start = world.start
    z_m = camera.height_m if config.vehicle == "copter" else 0.0
    return Motion(start.x_m, start.y_m, z_m, start.yaw_rad)


def make_video(config: Config) -> VideoStream | None:
    """Return the camera's network stream, if there is to be one."""
    if config.video is None:
        return None
    layout = FrameLayout.packed(PixelFormat.I420, config.width, config.height)
    return VideoStream(layout, config.fps, config.video)
