"""Training: learns what can be learnt, repeats by seed, and resumes as if never interrupted."""

# Torch leaves these of its own members without types.
# pyright: reportUnknownMemberType=false

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("torch", reason="torch is not installed: deploy/test --with-train")

import torch
from torch import nn

from crosses import GRAY, QUICK, cross, pictures, trainer
from juncnet.features import Extractor, Preprocessing
from juncnet.learning.augment import mirror, vary
from juncnet.learning.fit import CheckpointError, DivergedError, Trainer, cross_entropy, predict
from juncnet.learning.recipes import PAPER
from juncnet.network import build


def weights(t: Trainer) -> np.ndarray:
    return np.concatenate([v.numpy().ravel() for v in t.averaged.values()])


def test_training_learns_and_repeats_by_seed() -> None:
    runs = [trainer(), trainer()]
    assert all(run.run() for run in runs)
    np.testing.assert_array_equal(weights(runs[0]), weights(runs[1]))
    assert runs[0].curve == runs[1].curve
    assert runs[0].curve[-1].balanced_accuracy == 1.0
    other = trainer(seed=4)
    other.run()
    assert not np.array_equal(weights(other), weights(runs[0]))


@pytest.mark.parametrize("stops", [(1,), (2, 5)])
def test_an_interrupted_training_ends_as_an_uninterrupted_one(
    stops: Sequence[int], tmp_path: Path
) -> None:
    whole = trainer(QUICK.model_copy(update={"epochs": 2}))
    whole.run()
    path = tmp_path / "c.checkpoint"
    for at in stops:
        part = trainer(QUICK.model_copy(update={"epochs": 2}))
        if path.exists():
            part.resume(path)
        assert not part.run(path, stop=lambda part=part, at=at: part.step >= at)
        assert part.step == at
    last = trainer(QUICK.model_copy(update={"epochs": 2}))
    last.resume(path)
    assert last.run(path)
    np.testing.assert_array_equal(weights(last), weights(whole))
    assert last.curve == whole.curve


def test_a_curve_s_losses_are_means_the_last_one_s_too() -> None:
    still = {"rate": 1e-9, "mask_weight": 0, "augmentation": 0, "dropout": 0}
    t = trainer(QUICK.model_copy(update=still | {"epochs": 15}))
    t.run()
    seen = [point.samples // QUICK.batch for point in t.curve]
    assert seen[-2:] == [44, 45]
    loss = [point.loss for point in t.curve]
    np.testing.assert_allclose(loss, loss[0], rtol=0.1)


def test_the_best_weights_are_kept_where_that_is_wanted() -> None:
    recipe = QUICK.model_copy(update={"keep_best": True, "rate": 1.0, "epochs": 2})
    good = trainer()
    good.run()
    torch.manual_seed(0)
    network = build("robust", 1)
    network.load_state_dict(good.averaged)
    extractor = Extractor(GRAY)
    spoilt = Trainer(network, pictures(96, 0), pictures(32, 1), recipe, 0, extractor)
    assert spoilt.run()
    assert spoilt.curve[0].samples == 0
    for name, value in network.state_dict().items():
        assert torch.equal(value, good.averaged[name]), name


def test_a_diverged_training_says_so_at_once() -> None:
    with pytest.raises(DivergedError, match="lower rate than 1e\\+30"):
        trainer(QUICK.model_copy(update={"rate": 1e30, "schedule": "constant"})).run()


class Bright(nn.Module):
    """Calls bright pictures junctions."""

    def __init__(self) -> None:
        super().__init__()
        self.factor = nn.Parameter(torch.ones(1))

    def forward(self, features: torch.Tensor) -> torch.Tensor:
        bright = self.factor * features.mean(dim=(1, 2, 3))
        return torch.stack([-bright, bright], dim=1)


@pytest.mark.parametrize(
    ("label", "auc"), [([0, 1, -1], 1.0), ([1, 0, -1], 0.0), ([0, 0, -1], None), ([-1] * 3, None)]
)
def test_what_is_watched_is_none_and_junctions_without_the_band(
    label: Sequence[int], auc: float | None
) -> None:
    shades = np.array([50, 100, 200], np.uint8)
    gray = np.tile(shades[:, None, None], (1, 64, 64))
    watched = dataclasses.replace(pictures(3, 0), gray=gray, label=np.array(label))
    plain = Extractor(Preprocessing(channels=("gray",)))
    recipe = QUICK.model_copy(update={"epochs": 0.1})
    t = Trainer(Bright(), pictures(8, 0), pictures(8, 1), recipe, 0, plain, watched)
    t.run()
    assert t.curve[-1].watched_auc == auc


def test_a_checkpoint_of_another_training_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "c.checkpoint"
    trainer().save(path)
    with pytest.raises(CheckpointError, match="another seed: 3 instead of 4"):
        trainer(seed=4).resume(path)
    with pytest.raises(CheckpointError, match="another number of pictures"):
        trainer(n=64).resume(path)
    for name, other in (
        ("set of pictures", trainer(seen=(2, 1))),
        ("validation part", trainer(seen=(0, 2))),
        ("start", trainer(start=5)),
    ):
        with pytest.raises(CheckpointError, match=f"another {name}"):
            other.resume(path)
    path.write_bytes(b"nothing")
    with pytest.raises(CheckpointError, match="cannot be read"):
        trainer().resume(path)


def test_a_checkpoint_that_does_not_name_its_pictures_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "c.checkpoint"
    trainer().save(path)
    state = torch.load(path, weights_only=True)
    del state["what"]["set of pictures"]
    torch.save(state, path)
    with pytest.raises(CheckpointError, match="an earlier version wrote it"):
        trainer().resume(path)


def test_every_epoch_sees_every_picture_once() -> None:
    t = trainer(QUICK.model_copy(update={"batch": 50}), n=60)
    seen = list[int]()
    for step in range(6):
        t.step = step
        seen += t.chosen().tolist()
    for epoch in range(5):
        assert sorted(seen[60 * epoch : 60 * epoch + 60]) == list(range(60))


def test_the_rate_of_one_cycle_rises_and_falls_and_the_paper_s_stays() -> None:
    t = trainer()
    rates: list[float] = []
    for step in range(t.steps):
        t.step = step
        rates.append(t.rate())
    assert max(rates) == pytest.approx(QUICK.rate, rel=0.05)
    assert rates.index(max(rates)) <= 0.15 * t.steps
    assert rates[-1] < 0.01 * QUICK.rate
    assert PAPER.model_dump(include={"optimiser", "rate", "epochs", "batch", "schedule"}) == {
        "optimiser": "adam",
        "rate": 1e-5,
        "epochs": 200.0,
        "batch": 30,
        "schedule": "constant",
    }


def test_weights_of_classes_leave_a_probability_where_it_is() -> None:
    weight = torch.tensor([0.5, 3.0])
    for target in (0.3, 0.5):
        logit = torch.zeros(1, requires_grad=True)
        wanted = torch.tensor([[1 - target, target]])
        for _ in range(400):
            loss = cross_entropy(torch.stack([torch.zeros(1), logit], 1), wanted, weight)
            loss.backward()
            with torch.no_grad():
                logit -= logit.grad if logit.grad is not None else 0
            logit.grad = None
        assert torch.sigmoid(logit).item() == pytest.approx(target, abs=0.01)


def test_augmentation_keeps_what_is_there() -> None:
    gray, _ = cross(16, 0)
    rng = np.random.default_rng(0)
    masks = np.zeros((16, 32, 32), np.uint8)
    gray[:, :, :8], masks[:, :, :4] = 255, 1
    mirrored, both = mirror(gray, masks, rng)
    assert both is not None
    left = (mirrored[:, :, 0] == 255).all(axis=1)
    assert 0 < left.sum() < 16
    np.testing.assert_array_equal(both[:, 0, 0] == 1, left)
    varied = vary(gray, rng, 1.0)
    assert varied.shape == gray.shape
    assert varied.dtype == np.uint8
    assert not np.array_equal(varied, gray)
    assert vary(gray, rng, 0.0) is gray


def test_what_the_start_gets_wrong_is_repeated() -> None:
    given = pictures(4, 0)
    unsure = np.array([[0.7, 0.3], [0.5, 0.5], [0.3, 0.7], [0.1, 0.9]])
    more = given.with_wrong_repeated(unsure, 3)
    # Labels are none, junction, none, junction: the second and the third are wrong or unsure.
    np.testing.assert_array_equal(more.gray, given.gray[[0, 1, 1, 1, 2, 2, 2, 3]])
    np.testing.assert_array_equal(more.label, [0, 1, 1, 1, 0, 0, 0, 1])
    ramp = dataclasses.replace(given, target=np.full((4, 2), 0.5, np.float32))
    assert len(ramp.with_wrong_repeated(unsure, 3)) == 4


def test_predictions_are_probabilities() -> None:
    answer = predict(build("robust", 1), cross(3, 0)[0], Extractor(GRAY))
    np.testing.assert_allclose(answer.sum(axis=1), 1, atol=1e-6)
