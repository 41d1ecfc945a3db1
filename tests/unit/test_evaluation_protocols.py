"""Seen and unseen sites: what is said to be unseen was never trained on."""

import math
from pathlib import Path

import numpy as np
import pytest

from juncnet.learning.datasets import (
    Dataset,
    DatasetInfo,
    open_dataset,
    sites_of,
    write_info,
)
from juncnet.learning.evaluate import with_band
from juncnet.learning.evaluation.answers import Answers
from juncnet.learning.evaluation.protocols import divided, protocol_of
from juncnet.learning.samples import Samples

SITES, EACH = 12, 20


def dataset(folder: Path, sites: int = SITES) -> Dataset:
    """Return a dataset of shards: every site has both classes and a transition band."""
    n = sites * EACH
    rng = np.random.default_rng(0)
    label = np.tile(np.array([0, 0, 1, 2], np.uint8), n // 4)
    target = np.where(label == 2, 0.4, label).astype(np.float32)
    target[::40] = math.nan
    Samples(
        gray=rng.integers(0, 255, (n, 64, 64), np.uint8),
        target=target,
        label=label,
        mouth_m=np.full(n, 5, np.float32),
        height_m=np.full(n, 2, np.float32),
        site=np.repeat(np.arange(sites), EACH),
    ).save(folder / "a.npz")
    write_info(folder, DatasetInfo(classes=("none", "junction"), shards=("a.npz",)))
    return open_dataset(folder)


def test_unseen_sites_are_in_no_other_part_and_seen_ones_are_all_trained_on(tmp_path: Path):
    parts = divided(dataset(tmp_path))
    train, validation = set(parts.train.site), set(parts.validation.site)
    unseen, seen = set(parts.unseen.site), set(parts.seen.site)
    assert train
    assert unseen
    assert not unseen & (train | validation)
    assert not validation & train
    assert seen == train
    assert train | validation | unseen == {str(i) for i in range(SITES)}


def test_pictures_of_seen_sites_are_held_back_from_training(tmp_path: Path):
    parts = divided(dataset(tmp_path))
    trained = {parts.train.picture(i).tobytes() for i in range(len(parts.train))}
    held_back = {parts.seen.picture(i).tobytes() for i in range(len(parts.seen))}
    assert held_back
    assert not trained & held_back


def test_nothing_without_a_target_is_trained_on_and_no_band_is_judged(tmp_path: Path):
    parts = divided(dataset(tmp_path))
    assert np.isfinite(parts.train.target).all()
    assert (parts.unseen.label >= 0).all()
    assert (parts.seen.label >= 0).all()
    assert (parts.train.label < 0).any()


def test_a_limit_leaves_all_else_as_it_is(tmp_path: Path):
    data = dataset(tmp_path)
    whole, limited = divided(data), divided(data, limit=30)
    assert len(limited.train) == 30
    assert list(limited.unseen.site) == list(whole.unseen.site)


def test_splits_that_the_data_have_are_kept_and_named(tmp_path: Path):
    data = dataset(tmp_path)
    site = data.site.astype(int)
    split = np.where(site < 6, "train", np.where(site < 8, "validation", "test"))
    split = split.astype(np.str_)
    object.__setattr__(data, "split", split)
    assert set(divided(data).unseen.site) == {"8", "9", "10", "11"}
    assert protocol_of(data, "test") == "unseen sites"
    assert protocol_of(data, "all") == "no split"
    split[data.site == "8"] = np.tile(["train", "test"], EACH // 2)
    assert protocol_of(data, "test") == "seen sites"
    split[split == "train"] = "test"
    assert protocol_of(data, "test") == "no split"


def test_a_part_without_pictures_is_named(tmp_path: Path):
    data = dataset(tmp_path)
    split = np.where(data.site.astype(int) < 8, "train", "test").astype(np.str_)
    object.__setattr__(data, "split", split)
    with pytest.raises(ValueError, match="in the part validation"):
        divided(data)


def test_too_few_or_unknown_sites_are_refused(tmp_path: Path):
    with pytest.raises(ValueError, match="2 sites cannot be divided"):
        divided(dataset(tmp_path, sites=2))
    data = dataset(tmp_path)
    data.site[0] = ""
    with pytest.raises(ValueError, match="unknown"):
        divided(data)


def test_pictures_without_a_site_are_their_clip_or_stand_alone(tmp_path: Path):
    data = dataset(tmp_path)
    data.site[:3], data.clip[:2], data.clip[2] = "", "ride", ""
    site, known = sites_of(data)
    assert (site[0], site[1], site[2], known) == ("ride", "ride", "picture 2", False)


def test_the_band_is_judged_by_the_middle_of_its_ramp(tmp_path: Path):
    data = dataset(tmp_path)
    always_none = np.tile(np.array([[0.9, 0.1]], np.float32), (len(data), 1))
    given = Answers(data.classes, always_none, data.label, data.site, data.clip)
    assert with_band(given, data) == pytest.approx(0.5)
    by_target = np.nan_to_num(data.target, nan=0.5)
    given = Answers(data.classes, by_target, data.label, data.site, data.clip)
    assert with_band(given, data) == 1.0
