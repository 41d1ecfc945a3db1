"""What is trained in torch answers the same in onnxruntime, and learns what can be learnt."""


# Torch leaves these of its own members without types.
# pyright: reportUnknownMemberType=false

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

pytest.importorskip("torch", reason="torch is not installed: deploy/test --with-train")

import torch

from juncnet.camera import FAR_HEIGHTS, NEAR_ROW, CameraGeometry
from juncnet.features import Extractor, Preprocessing
from juncnet.learning.export import TOLERANCE, export
from juncnet.learning.samples import Samples
from juncnet.learning.synthetic import target
from juncnet.learning.train import balanced_accuracy, fit, predict
from juncnet.modelfile import ModelMetadata
from juncnet.network import Architecture, PaperNet, build
from juncnet_services.junction_inference.model import Model

GRAY = Preprocessing(channels=("gray",))


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
@pytest.mark.parametrize("architecture", ["paper", "robust"])
def test_onnx_answers_as_torch_does(architecture: Architecture, tmp_path: Path) -> None:
    torch.manual_seed(1)
    network = build(architecture)
    metadata = ModelMetadata(
        name="m",
        architecture=architecture,
        classes=("none", "junction"),
        preprocessing=Preprocessing(),
        near_row=NEAR_ROW,
        far_heights=FAR_HEIGHTS,
    )
    assert export(network, metadata, tmp_path / "m.onnx") < TOLERANCE
    model = Model(tmp_path / "m.onnx")
    assert model.metadata == metadata
    features = np.random.default_rng(0).random((5, 2, 64, 64), np.float32)
    with torch.no_grad():
        expected = torch.softmax(network.eval()(torch.from_numpy(features)), 1).numpy()
    np.testing.assert_allclose(model.probabilities(features), expected, atol=TOLERANCE)


def test_the_paper_s_network_has_its_layers() -> None:
    kinds = [type(layer).__name__ for layer in PaperNet().body]
    assert kinds.count("Conv2d") == 2
    assert kinds.count("MaxPool2d") == 2
    assert kinds.count("Linear") == 3  # two dense layers and the output layer


def test_the_target_is_one_half_where_the_band_begins_and_ends() -> None:
    camera = CameraGeometry()
    band = camera.band
    mouths = np.array([band.d_far_m, band.d_near_m, (band.d_far_m + band.d_near_m) / 2, np.inf, 0])
    np.testing.assert_allclose(target(mouths, camera), [0.5, 0.5, 1, 0, 0], atol=1e-6)


def samples(n: int, seed: int) -> Samples:
    """Pictures of noise; in those of junctions there is a bright cross."""
    rng = np.random.default_rng(seed)
    gray = rng.integers(60, 120, (n, 64, 64), dtype=np.uint8)
    label = (np.arange(n) % 2).astype(np.uint8)
    gray[label == 1, 28:36, :] = 220
    gray[label == 1, :, 28:36] = 220
    return Samples(
        gray=gray,
        target=label.astype(np.float32),
        label=label,
        mouth_m=np.ones(n, np.float32),
        height_m=np.ones(n, np.float32),
        site=np.arange(n),
    )


def test_training_learns_and_repeats_by_seed() -> None:
    extractor = Extractor(GRAY)
    outcomes: list[NDArray[np.float32]] = []
    for _ in range(2):
        torch.manual_seed(3)
        network = build("robust", channels=1)
        fit(
            network,
            samples(256, 0),
            samples(32, 1),
            extractor,
            epochs=5,
            batch=32,
            rate=8e-3,
            seed=3,
        )
        outcomes.append(predict(network, samples(32, 2), extractor))
    np.testing.assert_array_equal(outcomes[0], outcomes[1])
    assert balanced_accuracy(outcomes[0], samples(32, 2).label) == 1.0


def test_samples_survive_the_disk(tmp_path: Path) -> None:
    written = samples(6, 0)
    written.save(tmp_path / "s.npz")
    read = Samples.load(tmp_path / "s.npz")
    np.testing.assert_array_equal(read.gray, written.gray)
    np.testing.assert_array_equal(read.site, written.site)
    assert len(Samples.concatenate([read, read])) == 12
