"""What `juncnet doctor` sees of model, camera, vehicle and disk, without starting anything."""

import os
import shutil
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from juncnet.assets import asset_path
from juncnet.extras import install_command
from juncnet.flight import flights_root
from juncnet.layout import Layout, LayoutError, service_config
from juncnet.modelfile import ModelFileError
from juncnet_services.cli.doctor.findings import Finding, failure, ok, warning
from juncnet_services.cli.doctor.links import existing
from juncnet_services.command_output.vehicles import Vehicle, open_vehicle

ENOUGH_BYTES, LITTLE_BYTES = 1_000_000_000, 100_000_000
ANSWER_S = 8.0
"""How long a vehicle may take to answer what it is asked."""
LOW_BATTERY = 0.3
INSTALL = install_command("laptop")


def options_of(layout: Layout, service: str) -> Any:
    """Return the options of a process of the layout; None when it has none or they are wrong."""
    if service not in layout.processes:
        return None
    try:
        config: type[BaseModel] = service_config(service)
        return layout.section(service, config)
    except (LayoutError, ImportError):
        return None


def model(layout: Layout) -> Iterator[Finding]:
    """Load the model, and let it answer once."""
    options = options_of(layout, "junction_inference")
    if options is None:
        return
    try:
        from juncnet_services.junction_inference.model import Model

        path = asset_path(options.model, "models", ".onnx")
        loaded = Model(path)
    except ImportError as error:
        yield failure("model", str(error), INSTALL)
    except (ModelFileError, FileNotFoundError) as error:
        yield failure("model", str(error), "name an .onnx file in [junction_inference] model")
    else:
        classes = ", ".join(loaded.metadata.classes)
        yield ok("model", f"{loaded.identity.name} ({classes}), {path}")


def camera(layout: Layout) -> Iterator[Finding]:
    """Look for the camera that is configured, as far as it can be seen from here."""
    options = options_of(layout, "frame_capture")
    if options is None:
        return
    source: Any = options.source
    place = getattr(source, "device", None) or getattr(source, "path", None)
    if place is None:
        where = getattr(source, "url", None) or getattr(source, "port", None)
        text = f"{source.kind}{'' if where is None else f' {where}'}: seen only while it runs"
        yield ok("camera", text)
        return
    path = Path(place)
    if not path.exists():
        yield failure(
            "camera",
            f"{path}: there is no such file or device",
            "plug the camera in, or name it in [frame_capture] source",
        )
    elif not os.access(path, os.R_OK):
        yield failure(
            "camera", f"{path} cannot be read", "sudo usermod -aG video $USER, then log in again"
        )
    else:
        yield ok("camera", f"{source.kind} {path}")


def vehicle(layout: Layout, ask: bool, flight_dir: Path) -> Iterator[Finding]:
    """Name the driver; `ask`: connect to the vehicle itself, and see what it says.

    What is wrong with the driver's options is found with the layout. Asking ends with what the
    driver does at its end, zero velocity or a landing.
    """
    options = options_of(layout, "command_output")
    if options is None:
        return
    if not ask:
        yield ok("vehicle", f"{options.vehicle}; ask the vehicle itself with --vehicle")
        return
    try:
        asked = open_vehicle(options.vehicle, options.options, flight_dir)
    except (ValueError, OSError) as error:
        yield failure("vehicle", f"{options.vehicle}: {error}", "is it on, and its address right?")
        return
    try:
        yield from answers(options.vehicle, asked)
    finally:
        asked.close()


def answers(name: str, asked: Vehicle) -> Iterator[Finding]:
    """Wait until the vehicle answers and has nothing to complain of, `ANSWER_S` at most."""
    deadline = time.monotonic() + ANSWER_S
    telemetry = None
    while time.monotonic() < deadline:
        telemetry = asked.telemetry(1.0)
        if not asked.trouble and (telemetry is not None or not asked.capabilities.telemetry):
            break
        time.sleep(0.1)
    if asked.trouble:
        what, _, remedy = asked.trouble.partition(": ")
        yield failure("vehicle", f"{name}: {what}", remedy or "then look again")
    elif telemetry is None and asked.capabilities.telemetry:
        yield failure("vehicle", f"{name} does not answer", "is it on, and its address right?")
    else:
        yield ok("vehicle", f"{name} answers, and will fly")
    if telemetry is not None and telemetry.battery is not None:
        yield battery(telemetry.battery)


def battery(charge: float) -> Finding:
    """Return what to think of a battery charged to `charge`, 0 to 1."""
    text = f"{100 * charge:.0f} %"
    return ok("battery", text) if charge >= LOW_BATTERY else warning("battery", text, "charge it")


def disk(layout: Layout) -> Iterator[Finding]:
    """Look at the space where state, sockets, logs and recordings go."""
    recorder = options_of(layout, "recorder")
    folders: Sequence[Path] = [
        layout.state_dir,
        flights_root(),
        *([] if recorder is None else [recorder.folder]),
    ]
    for folder in folders:
        place = existing(folder)
        free = shutil.disk_usage(place).free
        text = f"{folder}: {free / 1e9:.1f} GB free"
        if not os.access(place, os.W_OK):
            yield failure("disk", f"{folder} cannot be written", f"sudo chown $USER {place}")
        elif free < LITTLE_BYTES:
            yield failure("disk", text, "make room: a stop must be kept on disk")
        elif free < ENOUGH_BYTES:
            yield warning("disk", text, "make room for logs and recordings")
        else:
            yield ok("disk", text)
