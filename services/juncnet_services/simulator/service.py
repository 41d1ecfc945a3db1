"""simulator: vehicle link -> simulator/camera, simulator/truth."""

from contextlib import closing

from juncnet.bus import Bus
from juncnet.launch import launch
from juncnet.messages import Stamp
from juncnet.topics import SIMULATOR_TRUTH
from juncnet_services.simulator.camera import Camera
from juncnet_services.simulator.drone import Drone
from juncnet_services.simulator.observer import Observer
from juncnet_services.simulator.pace import Pace, RealTime
from juncnet_services.simulator.setup import (
    Config,
    make_camera,
    make_vehicle,
    make_world,
    starting_motion,
)


class Simulation:
    """The drone, its camera and who watches it, connected to a bus."""

    def __init__(self, bus: Bus, config: Config) -> None:
        world, geometry = make_world(config), make_camera(config)
        start, airborne = starting_motion(config, world, geometry), config.vehicle == "copter"
        self.bus = bus
        self.header: Stamp | None = None
        self.camera = Camera(bus, config, world)
        self.observer = Observer(world, geometry)
        self.real_time = RealTime(config.fps)
        now_ns = bus.clock.now_ns()
        self.drone = Drone(make_vehicle(config), start, config.link_loss_s, now_ns, airborne)

    def take_picture(self) -> None:
        """Send what the camera sees at this instant under this instant's stamp."""
        header = self.camera.stamp()
        self.camera.take(self.drone.at(header.time_ns), header)
        self.header = header
        self.real_time.note_frame(self.bus.clock.now_ns())
        self.bus.health.output(header.time_ns, header)

    def tell_truth(self) -> None:
        """Publish the truth of this instant."""
        at = self.bus.stamp()
        motion, simulated_s = self.drone.at(at.time_ns), self.drone.simulated_s
        factor = self.real_time.factor(at.time_ns, simulated_s)
        truth = self.observer.truth(motion, at, self.header, simulated_s, factor)
        self.bus.publish(SIMULATOR_TRUTH, truth)
        self.bus.health.set("real_time_factor", factor)
        for error in self.drone.take_errors():
            self.bus.health.error(error)


def run(bus: Bus, config: Config) -> None:
    """Fly what the vehicle link says and show it until the bus ends."""
    simulation = Simulation(bus, config)
    camera, truth = Pace(config.fps), Pace(config.truth_hz)
    with (
        closing(simulation.camera),
        simulation.drone.linked(bus.flight_dir, bus.clock.now_ns),
    ):
        while bus.running:
            if truth.due(bus.clock.now_ns()):
                simulation.tell_truth()
            if camera.due(bus.clock.now_ns()):
                simulation.take_picture()
            now_ns = bus.clock.now_ns()
            bus.wait(min(camera.wait_s(now_ns), truth.wait_s(now_ns)))


def main() -> None:
    """Run the simulator."""
    launch(run, Config)
