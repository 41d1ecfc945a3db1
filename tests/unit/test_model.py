"""A model file is checked before it is believed; the old one stays until the new one answers."""

from pathlib import Path

import numpy as np
import pytest

from juncnet.features import Preprocessing
from juncnet.modelfile import ModelFileError, ModelMetadata
from juncnet_services.junction_inference.model import MAX_BATCH, Model, ModelSlot
from scenes import stamp, tiny_model


def features(value: float) -> np.ndarray[tuple[int, ...], np.dtype[np.float32]]:
    return np.full((1, 64, 64), value, np.float32)


def test_the_brighter_of_two_is_the_junction(tmp_path: Path) -> None:
    model = Model(tiny_model(tmp_path / "m.onnx"))
    dark, bright = model.score([features(0.0), features(1.0)])
    assert bright["junction"] == pytest.approx(1 / (1 + np.exp(-4.0)), abs=1e-5)
    assert dark["junction"] == pytest.approx(1 / (1 + np.exp(4.0)), abs=1e-5)


def test_more_than_a_batch_is_scored_in_order(tmp_path: Path) -> None:
    model = Model(tiny_model(tmp_path / "m.onnx"))
    values = np.linspace(0, 1, 2 * MAX_BATCH + 7)
    headers = [stamp(1 + i) for i in range(len(values))]
    scores = model.scores(headers, [features(v) for v in values])
    assert [s.header for s in scores] == headers
    junction = [s.junction for s in scores]
    assert junction == sorted(junction)
    assert len(set(junction)) == len(values)


def test_scores_carry_the_file_s_identity(tmp_path: Path) -> None:
    model = Model(tiny_model(tmp_path / "m.onnx", name="mine"))
    (score,) = model.scores([stamp()], [features(0.2)])
    assert score.model == model.identity == model.active.model
    assert score.model.name == "mine"
    other = Model(tiny_model(tmp_path / "n.onnx", name="mine", gain=7.0))
    assert other.identity.sha256 != model.identity.sha256


def test_features_of_another_preprocessing_are_refused(tmp_path: Path) -> None:
    model = Model(tiny_model(tmp_path / "m.onnx"))
    own = model.preprocessing.hash
    assert model.refusal(own, (1, 64, 64)) is None
    assert "needs" in (model.refusal(Preprocessing(sharpening=2.0).hash, (1, 64, 64)) or "")
    assert "(1, 32, 32)" in (model.refusal(own, (1, 32, 32)) or "")


def test_many_classes_keep_their_names(tmp_path: Path) -> None:
    model = Model(tiny_model(tmp_path / "m.onnx", classes=("none", "first", "second")))
    (score,) = model.scores([stamp()], [features(1.0)])
    assert score.label in ("first", "second")
    assert score.junction > 0.9


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ModelFileError, match="nowhere"):
        Model(tmp_path / "nowhere.onnx")


def test_a_file_that_is_no_model_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "m.onnx"
    path.write_bytes(b"not a model")
    with pytest.raises(ModelFileError, match="not a valid ONNX"):
        Model(path)


def test_a_model_without_softmax_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ModelFileError, match="softmax"):
        Model(tiny_model(tmp_path / "m.onnx", softmax=False))


def test_metadata_are_refused_by_field() -> None:
    with pytest.raises(ModelFileError, match="no JuncNet metadata"):
        ModelMetadata.from_properties({})
    with pytest.raises(ModelFileError, match="classes"):
        ModelMetadata.from_properties({"juncnet": '{"name": "a", "classes": ["none"]}'})


def test_a_broken_file_leaves_the_old_model_in_service(tmp_path: Path) -> None:
    slot = ModelSlot(Model(tiny_model(tmp_path / "m.onnx", name="old")))
    with pytest.raises(ModelFileError):
        slot.load(tmp_path / "missing.onnx")
    assert slot.model.identity.name == "old"
    slot.load(tiny_model(tmp_path / "n.onnx", name="new"))
    assert slot.model.identity.name == "new"
