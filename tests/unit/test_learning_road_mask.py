"""The road mask's files: the mean of two networks, and how a file is scored."""

# Torch leaves these of its own members without types.
# pyright: reportUnknownMemberType=false

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("torch", reason="torch is not installed: deploy/test --with-train")

import torch

from juncnet.learning.road_mask import (
    MASK_SIZE,
    Pictures,
    RoadMaskNet,
    export,
    export_mean,
    intersection_over_union,
)
from juncnet.small_picture import SIZE
from juncnet_services.road_following.masks import NetworkMask

pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning")
"""Of torch's exporter: the other one needs a package more."""


def exported(seed: int, path: Path) -> Path:
    torch.manual_seed(seed)
    export(RoadMaskNet().eval(), path)
    return path


def test_the_mean_of_two_masks_answers_with_their_mean(tmp_path: Path) -> None:
    one, other = exported(1, tmp_path / "one.onnx"), exported(2, tmp_path / "other.onnx")
    export_mean(one, other, tmp_path / "mean.onnx")
    picture = np.random.default_rng(0).integers(0, 256, (SIZE[1], SIZE[0], 3), dtype=np.uint8)
    first, second, mean = (
        NetworkMask(file).probability(picture) for file in (one, other, tmp_path / "mean.onnx")
    )
    assert np.abs(first - second).max() > 0.01
    np.testing.assert_allclose(mean, (first + second) / 2, atol=1e-6)


def test_a_file_is_scored_by_the_cells_that_it_and_the_truth_share(tmp_path: Path) -> None:
    file = exported(1, tmp_path / "one.onnx")
    picture = np.random.default_rng(0).integers(0, 256, (SIZE[1], SIZE[0], 3), dtype=np.uint8)
    found = NetworkMask(file).probability(picture) > 0.5
    assert 0 < found.sum() < found.size
    road = np.where(found, 255, 0).astype(np.uint8)
    everywhere = np.full(MASK_SIZE[::-1], 255, np.uint8)
    for truth, share in ((road, 1.0), (everywhere, found.mean())):
        data = Pictures(picture[None], truth[None])
        assert intersection_over_union(file, data) == pytest.approx(share)
