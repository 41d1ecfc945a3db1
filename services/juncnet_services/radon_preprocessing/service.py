"""radon_preprocessing: camera/frame -> radon/features.

Turns the newest frame into network input, by the preprocessing that the model in service asks for.
"""

from pydantic import BaseModel, ConfigDict

from juncnet.bus import Bus
from juncnet.features import Preprocessing
from juncnet.frames import Frame
from juncnet.launch import launch
from juncnet.messages import ActiveModel, Features
from juncnet.topics import CAMERA_FRAME, MODEL_ACTIVE, RADON_FEATURES
from juncnet_services.radon_preprocessing.extractors import ExtractorSlot


class Config(BaseModel):
    """Options of `radon_preprocessing`."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    preprocessing: Preprocessing = Preprocessing()
    """What is done until `model/active` has named what the model asks for."""


def run(bus: Bus, config: Config) -> None:
    """Publish the features of the newest frame until the bus stops."""
    slot = ExtractorSlot(config.preprocessing)
    models = bus.subscribe(MODEL_ACTIVE)
    frames = bus.frames_in(CAMERA_FRAME)
    while bus.running:
        obey(bus, slot, models.take())
        with frames.take(0.5) as frame:
            if frame is not None:
                taken_ns = bus.clock.now_ns()
                features = extract(bus, slot, frame)
                if features is not None:
                    bus.publish(RADON_FEATURES, features)
                    bus.health.output(taken_ns, frame.header)


def obey(bus: Bus, slot: ExtractorSlot, active: ActiveModel | None) -> None:
    """Change to what a newly active model asks for; if that cannot be done, the old one stays."""
    if active is None:
        return
    try:
        slot.change(active.preprocessing, active.preprocessing_hash)
    except ValueError as error:
        bus.health.error(f"preprocessing of {active.model.name} refused: {error}")


def extract(bus: Bus, slot: ExtractorSlot, frame: Frame) -> Features | None:
    """Return the frame's features under its own header; None, and an error, if there are none."""
    try:
        array = slot.extractor(frame.luminance())
        return Features.from_array(array, frame.header, slot.hash)
    except ValueError as error:
        bus.health.error(f"frame {frame.header.sequence} skipped: {error}")
        return None


def main() -> None:
    """Start the process."""
    launch(run, Config)
