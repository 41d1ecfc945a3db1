"""junction_inference: radon/features, model/load -> junction/score, model/active.

Scores the newest features of every robot it serves, in one batch, with the model in service.
"""

from pathlib import Path

from pydantic import BaseModel, ConfigDict

from juncnet.assets import asset_path
from juncnet.bus import Bus
from juncnet.launch import launch
from juncnet.messages import Features, JunctionScore, LoadModel, Reply
from juncnet.modelfile import ModelFileError
from juncnet.topics import JUNCTION_SCORE, MODEL_ACTIVE, MODEL_LOAD, RADON_FEATURES
from juncnet_services.junction_inference.model import Model, ModelSlot


class Config(BaseModel):
    """Options of `junction_inference`."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    model: str = "juncnet"
    """The ONNX file: a path, or a shipped model."""
    robots: str = "own"
    """`own`: features of this layout's robot; `*`: of every robot on the network, in batches."""


def run(bus: Bus, config: Config) -> None:
    """Score features until the bus stops."""
    slot = ModelSlot(Model(asset_path(config.model, "models", ".onnx")))
    bus.publish(MODEL_ACTIVE, slot.model.active)

    def load(request: LoadModel) -> Reply:
        try:
            model = slot.load(Path(request.path))
        except ModelFileError as error:
            return Reply(accepted=False, reason=f"{error}; {slot.model.identity.name} stays")
        bus.publish(MODEL_ACTIVE, model.active)
        return Reply(accepted=True)

    bus.serve(MODEL_LOAD, load)
    inbox = bus.subscribe(RADON_FEATURES, robot="*" if config.robots == "*" else None)
    while bus.running:
        if bus.wait(0.5):
            taken_ns = bus.clock.now_ns()
            for robot, answer in score(bus, slot.model, inbox.drain()):
                bus.publish(JUNCTION_SCORE, answer, robot)
                bus.health.output(taken_ns, answer.header)


def score(
    bus: Bus, model: Model, inputs: list[tuple[str, Features]]
) -> list[tuple[str, JunctionScore]]:
    """Return the scores of what can be scored, by robot; the rest is an error in the health."""
    accepted: list[tuple[str, Features]] = []
    for robot, features in inputs:
        reason = model.refusal(features.preprocessing, features.shape)
        if reason is None:
            accepted.append((robot, features))
        else:
            bus.health.error(f"features of {robot} refused: {reason}")
    answers = model.scores([f.header for _, f in accepted], [f.array for _, f in accepted])
    return [(robot, answer) for (robot, _), answer in zip(accepted, answers, strict=True)]


def main() -> None:
    """Start the process."""
    launch(run, Config)
