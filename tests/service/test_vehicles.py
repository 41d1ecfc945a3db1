"""What holds for every driver: shipped ones are found, and one from outside the package flies."""

import subprocess
import sys
from contextlib import closing
from pathlib import Path
from typing import Any, Literal

import pytest
from pydantic import Field, ValidationError

from juncnet.assets import asset_path
from juncnet.extras import install_command
from juncnet.layout import LayoutError, load_layout
from juncnet.messages import Capabilities, Velocity
from juncnet_services.command_output.service import Config
from juncnet_services.command_output.vehicles import (
    SHIPPED,
    DriverOptions,
    Hold,
    Telemetry,
    driver,
    open_vehicle,
)
from juncnet_services.kits.vehicle_probe import ProbedVehicle, ProbeOptions

OURS = f"{__name__}:CartVehicle"
LAYOUTS = ("bebop", "px4_copter", "ardupilot_rover", "ros2")


class CartOptions(DriverOptions):
    """Options of a driver that lives in the folder of these tests."""

    steering: Literal["tank", "ackermann"]
    wheel_m: float = Field(default=0.1, gt=0)


class CartVehicle:
    """Turns speeds into revolutions of two wheels, and keeps them."""

    Options = CartOptions

    def __init__(self, options: CartOptions, flight_dir: Path) -> None:
        self.options, self.flight_dir = options, flight_dir
        self.capabilities = Capabilities(kind="rover", turns_in_place=options.steering == "tank")
        self.send_failures, self.trouble = 0, ""
        self.turns: list[float] = []

    def send(self, velocity: Velocity, brake: bool, lasts_s: float) -> None:
        self.turns.append(0.0 if brake else velocity.forward_mps / self.options.wheel_m)

    def take_off(self) -> None: ...
    def land(self) -> None: ...
    def emergency(self) -> None: ...
    def hold(self) -> Hold | None:
        return None

    def telemetry(self, max_age_s: float) -> Telemetry | None:
        return None

    def close(self) -> None: ...


def test_a_driver_from_outside_is_made_with_its_validated_options(tmp_path: Path) -> None:
    vehicle = open_vehicle(OURS, {"steering": "tank", "wheel_m": 0.2}, tmp_path)
    assert isinstance(vehicle, CartVehicle)
    assert vehicle.options == CartOptions(steering="tank", wheel_m=0.2)
    assert vehicle.capabilities.turns_in_place
    vehicle.send(Velocity(forward_mps=1.0), brake=False, lasts_s=0.15)
    assert vehicle.turns == [5.0]


@pytest.mark.parametrize(
    ("vehicle", "options", "told"),
    [
        (OURS, {"steering": "crab"}, "options.steering"),
        (OURS, {"steering": "tank", "wheels": 4}, "options.wheels"),
        (OURS, {}, "options.steering"),
        ("bebop", {"video": "1080p"}, "options.video"),
        ("bebop", {"tuning": {"max_tilt_deg": 90}}, "options.tuning.max_tilt_deg"),
        ("ros2", {"endpoint": "localhost"}, "options.endpoint"),
        ("warp", {}, "no vehicle 'warp'"),
        ("no.such:Driver", {}, "cannot be loaded"),
    ],
)
def test_wrong_options_are_named_before_anything_starts(
    vehicle: str, options: dict[str, Any], told: str
) -> None:
    with pytest.raises(ValidationError, match=told):
        Config(vehicle=vehicle, options=options)


@pytest.mark.parametrize("name", SHIPPED)
def test_every_shipped_driver_is_a_whole_vehicle(name: str) -> None:
    if name == "mavlink":
        pytest.importorskip("pymavlink", reason="extra [mavlink] is not installed")
    found = driver(name)
    for part in ("send", "take_off", "land", "emergency", "hold", "telemetry", "close"):
        assert callable(getattr(found, part)), part
    assert found.Options.model_config.get("extra") == "forbid"


def test_the_probe_hands_an_aborted_take_off_on_to_a_driver_that_has_it(tmp_path: Path) -> None:
    for name, calls in (("log", 1), ("simulated", 0)):
        log = tmp_path / f"{name}.jsonl"
        options = ProbeOptions(driver=name, log=log)
        with closing(ProbedVehicle(options, tmp_path)) as vehicle:
            vehicle.abort_take_off()
        assert log.read_text().count('"abort_take_off"') == calls


def test_without_pymavlink_the_extra_is_named() -> None:
    script = (
        "import sys; sys.modules['pymavlink'] = None\n"
        "from juncnet_services.command_output.vehicles import driver\n"
        "try: driver('mavlink')\n"
        "except ValueError as error: print(error)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    assert done.stdout.rstrip().endswith(install_command("mavlink"))


@pytest.mark.parametrize("name", LAYOUTS)
def test_the_layout_of_a_vehicle_is_valid(name: str) -> None:
    if "mavlink" in asset_path(name, "layouts", ".toml").read_text():
        pytest.importorskip("pymavlink", reason="extra [mavlink] is not installed")
    load_layout(asset_path(name, "layouts", ".toml")).validate_all()


def test_a_wrong_option_in_a_layout_is_named_with_its_file() -> None:
    path = asset_path("bebop", "layouts", ".toml")
    layout = load_layout(path, ["command_output.options.adress=10.0.0.1"])
    with pytest.raises(LayoutError, match=r"bebop\.toml.*options\.adress"):
        layout.validate_all()


def test_no_drivers_name_stands_in_the_shell() -> None:
    folder = Path(__file__).parents[2] / "services/juncnet_services/command_output"
    for path in folder.glob("*.py"):
        text = path.read_text().lower()
        for name in ("bebop", "mavlink", "ros2", "arsdk", "px4"):
            assert name not in text, f"{path.name} knows {name}"
