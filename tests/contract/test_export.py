"""What is trained in torch answers the same in onnxruntime, and its file can be trained further."""

# Torch leaves these of its own members without types.
# pyright: reportUnknownMemberType=false

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("torch", reason="torch is not installed: deploy/test --with-train")

import torch
from torch import nn

from juncnet.camera import FAR_HEIGHTS, NEAR_ROW, CameraGeometry
from juncnet.features import Preprocessing
from juncnet.learning.export import TOLERANCE, export
from juncnet.learning.synthetic import target
from juncnet.learning.weights import WeightsError, round_to_int8, start_from
from juncnet.modelfile import ModelMetadata
from juncnet.network import Architecture, PaperNet, build
from juncnet_services.junction_inference.model import Model


def metadata(architecture: Architecture) -> ModelMetadata:
    return ModelMetadata(
        name="m",
        architecture=architecture,
        classes=("none", "junction"),
        preprocessing=Preprocessing(),
        near_row=NEAR_ROW,
        far_heights=FAR_HEIGHTS,
    )


def seasoned(architecture: Architecture, mirror_mean: bool = False) -> nn.Module:
    """Return a network whose normalisation has seen something, so that folding it would show."""
    torch.manual_seed(1)
    network = build(architecture, mirror_mean=mirror_mean)
    network.train()
    with torch.no_grad():
        network(3 * torch.rand(32, 2, 64, 64) + 1)
    return network.eval()


def probabilities(network: nn.Module, features: np.ndarray) -> np.ndarray:
    with torch.no_grad():
        return torch.softmax(network(torch.from_numpy(features)), 1).numpy()


@pytest.mark.parametrize("int8", [False, True])
@pytest.mark.parametrize("architecture", ["paper", "robust"])
def test_onnx_answers_as_torch_does(architecture: Architecture, int8: bool, tmp_path: Path) -> None:
    network = seasoned(architecture)
    exported = export(network, metadata(architecture), tmp_path / "m.onnx", int8)
    assert exported.deviation < TOLERANCE
    assert (exported.rounding > 0) is int8
    model = Model(tmp_path / "m.onnx")
    assert model.metadata == metadata(architecture)
    features = np.random.default_rng(0).random((5, 2, 64, 64), np.float32)
    if int8:
        round_to_int8(network)
    expected = probabilities(network, features)
    np.testing.assert_allclose(model.probabilities(features), expected, atol=TOLERANCE)


def test_a_refused_network_leaves_the_file_that_was_there(tmp_path: Path) -> None:
    path = tmp_path / "m.onnx"
    path.write_bytes(b"a good one")
    network = seasoned("robust")
    with torch.no_grad():
        next(network.parameters()).fill_(float("nan"))
    with pytest.raises(ValueError, match=r"m\.onnx: the answers are no numbers"):
        export(network, metadata("robust"), path)
    assert path.read_bytes() == b"a good one"
    assert [p.name for p in tmp_path.iterdir()] == ["m.onnx"]


@pytest.mark.parametrize("mirror_mean", [True, False])
def test_a_mirrored_picture_gets_the_same_answer_with_the_mean_alone(
    mirror_mean: bool, tmp_path: Path
) -> None:
    network = seasoned("robust", mirror_mean)
    export(network, metadata("robust"), tmp_path / "m.onnx")
    features = np.zeros((1, 2, 64, 64), np.float32)
    features[..., 20:60, 4:20] = 10.0
    mirrored = np.ascontiguousarray(features[..., ::-1])
    model = Model(tmp_path / "m.onnx")
    difference = np.abs(model.probabilities(mirrored) - model.probabilities(features)).max()
    assert bool(difference < TOLERANCE) is mirror_mean


def test_int8_takes_a_quarter_of_the_bytes(tmp_path: Path) -> None:
    network = seasoned("paper")
    export(network, metadata("paper"), tmp_path / "whole.onnx")
    export(network, metadata("paper"), tmp_path / "packed.onnx", int8=True)
    whole, packed = ((tmp_path / f"{n}.onnx").stat().st_size for n in ("whole", "packed"))
    assert packed < 0.27 * whole


@pytest.mark.parametrize("int8", [False, True])
@pytest.mark.parametrize("architecture", ["paper", "robust"])
def test_training_goes_on_from_a_file(
    architecture: Architecture, int8: bool, tmp_path: Path
) -> None:
    network = seasoned(architecture)
    export(network, metadata(architecture), tmp_path / "m.onnx", int8)
    other = build(architecture)
    start_from(other, tmp_path / "m.onnx", same_classes=True)
    if int8:
        round_to_int8(network)
    features = np.random.default_rng(0).random((3, 2, 64, 64), np.float32)
    expected = probabilities(network, features)
    np.testing.assert_allclose(probabilities(other.eval(), features), expected, atol=1e-5)


def test_other_classes_keep_all_but_the_last_layer(tmp_path: Path) -> None:
    network = seasoned("robust")
    export(network, metadata("robust"), tmp_path / "m.onnx")
    other = build("robust", classes=4)
    start_from(other, tmp_path / "m.onnx", same_classes=False)
    mine, theirs = other.state_dict(), network.state_dict()
    differ = {k for k in mine if mine[k].shape != theirs[k].shape}
    assert differ == {"body.10.weight", "body.10.bias"}
    assert torch.equal(mine["body.8.weight"], theirs["body.8.weight"])


def test_another_architecture_is_refused(tmp_path: Path) -> None:
    export(seasoned("robust"), metadata("robust"), tmp_path / "m.onnx")
    with pytest.raises(WeightsError, match="same architecture"):
        start_from(build("paper"), tmp_path / "m.onnx", same_classes=True)
    (tmp_path / "no.onnx").write_bytes(b"nothing")
    with pytest.raises(WeightsError, match="not a readable ONNX file"):
        start_from(build("paper"), tmp_path / "no.onnx", same_classes=True)


def test_the_paper_s_network_has_its_layers() -> None:
    kinds = [type(layer).__name__ for layer in PaperNet().body]
    assert kinds.count("Conv2d") == 2
    assert kinds.count("MaxPool2d") == 2
    assert kinds.count("Linear") == 3  # two dense layers and the output layer


@pytest.mark.parametrize("size", [8, 32, 63, 64, 65, 96])
def test_the_paper_s_network_takes_every_size_of_input(size: int) -> None:
    assert PaperNet(classes=3, size=size)(torch.zeros(2, 2, size, size)).shape == (2, 3)


def test_the_target_is_one_half_where_the_band_begins_and_ends() -> None:
    camera = CameraGeometry()
    band = camera.band
    mouths = np.array([band.d_far_m, band.d_near_m, (band.d_far_m + band.d_near_m) / 2, np.inf, 0])
    np.testing.assert_allclose(target(mouths, camera), [0.5, 0.5, 1, 0, 0], atol=1e-6)
