"""junction_inference scores what fits its model, refuses the rest and swaps models in service."""

from pathlib import Path

import numpy as np
import pytest

from fakes import FakeBus
from juncnet.features import Preprocessing
from juncnet.messages import Features, LoadModel
from juncnet.topics import JUNCTION_SCORE, MODEL_ACTIVE, MODEL_LOAD, RADON_FEATURES
from juncnet_services.junction_inference.service import Config, run
from scenes import stamp, tiny_model

OWN = Preprocessing(channels=("gray",))


def message(value: float, second: float, preprocessing: Preprocessing = OWN) -> Features:
    array = np.full((1, 64, 64), value, np.float32)
    return Features.from_array(array, stamp(second), preprocessing.hash)


@pytest.fixture
def model(tmp_path: Path) -> str:
    return str(tiny_model(tmp_path / "model.onnx", name="first"))


def test_scores_follow_the_frames(model: str) -> None:
    bus = FakeBus([(RADON_FEATURES, message(0.0, 1)), (RADON_FEATURES, message(1.0, 2))])
    run(bus, Config(model=model))
    scores = bus.published[JUNCTION_SCORE.key]
    assert [s.header for s in scores] == [stamp(1), stamp(2)]
    assert scores[0].junction < 0.1 < 0.9 < scores[1].junction
    assert bus.health.outputs == 2


def test_the_model_announces_itself(model: str) -> None:
    bus = FakeBus([(RADON_FEATURES, message(0.0, 1))])
    run(bus, Config(model=model))
    (active,) = bus.published[MODEL_ACTIVE.key]
    assert active.model.name == "first"
    assert active.preprocessing_hash == OWN.hash
    assert Preprocessing.model_validate_json(active.preprocessing) == OWN


def test_features_of_another_preprocessing_are_an_error(model: str) -> None:
    other = Preprocessing(channels=("gray",), sharpening=0.0)
    bus = FakeBus([(RADON_FEATURES, message(1.0, 1, other)), (RADON_FEATURES, message(1.0, 2))])
    run(bus, Config(model=model))
    assert [s.header for s in bus.published[JUNCTION_SCORE.key]] == [stamp(2)]
    assert len(bus.health.errors) == 1
    assert "refused" in bus.health.errors[0]


def test_robots_are_scored_under_their_own_names(model: str) -> None:
    script = [((name, RADON_FEATURES), message(1.0, i + 1)) for i, name in enumerate("ab")]
    bus = FakeBus(script)
    run(bus, Config(model=model, robots="*"))
    as_whom = [robot for robot, key, _ in bus.published_as if key == JUNCTION_SCORE.key]
    assert as_whom == ["a", "b"]


def test_a_model_is_swapped_on_request_and_a_broken_one_is_not(model: str, tmp_path: Path) -> None:
    second = tiny_model(tmp_path / "second.onnx", name="second", gain=-8.0)
    replies: list[bool] = []

    def load(path: Path) -> None:
        reply = bus.handlers[MODEL_LOAD.key](LoadModel(path=str(path)))
        replies.append(reply.accepted)
        assert reply.accepted or "first stays" in reply.reason

    bus = FakeBus(
        [
            (RADON_FEATURES, message(1.0, 1)),
            lambda _: load(tmp_path / "missing.onnx"),
            (RADON_FEATURES, message(1.0, 2)),
            lambda _: load(second),
            (RADON_FEATURES, message(1.0, 3)),
        ]
    )
    run(bus, Config(model=model))
    assert replies == [False, True]
    names = [s.model.name for s in bus.published[JUNCTION_SCORE.key]]
    assert names == ["first", "first", "second"]
    assert [a.model.name for a in bus.published[MODEL_ACTIVE.key]] == ["first", "second"]
