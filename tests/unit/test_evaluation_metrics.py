"""Figures of merit: values worked out by hand, and the definition of each as an oracle."""

import numpy as np
import pytest

from juncnet.learning.evaluation.answers import Answers
from juncnet.learning.evaluation.intervals import interval, site_counts
from juncnet.learning.evaluation.metrics import (
    Ranking,
    accuracy,
    balanced_accuracy,
    calibration_error,
    confusion_matrix,
    f1,
    precisions,
    recalls,
)
from juncnet.learning.evaluation.scores import score

CONFUSION = np.array([[8, 2], [1, 9]])


def answers(
    probability: list[float],
    label: list[int],
    site: list[str] | None = None,
    group: list[str] | None = None,
) -> Answers:
    p = np.array(probability, np.float32)
    n = len(label)
    return Answers(
        classes=("none", "junction"),
        probability=np.stack([1 - p, p], axis=1),
        label=np.array(label, np.int64),
        site=np.array(site or [str(i) for i in range(n)]),
        group=np.array(group or ["all"] * n),
    )


def test_confusion_has_the_truth_by_row():
    truth, answer = np.array([0, 0, 1, 2]), np.array([0, 2, 1, 2])
    assert confusion_matrix(truth, answer, 3).tolist() == [[1, 0, 1], [0, 1, 0], [0, 0, 1]]


def test_figures_of_a_confusion_matrix():
    assert accuracy(CONFUSION) == pytest.approx(17 / 20)
    assert recalls(CONFUSION) == pytest.approx([0.8, 0.9])
    assert precisions(CONFUSION) == pytest.approx([8 / 9, 9 / 11])
    assert f1(CONFUSION, positive=1) == pytest.approx(18 / 21)
    assert f1(CONFUSION, positive=None) == pytest.approx((18 / 21 + 16 / 19) / 2)


def test_balanced_accuracy_ignores_how_often_a_class_occurs_and_absent_classes():
    assert balanced_accuracy(CONFUSION * [[100], [1]]) == pytest.approx(0.85)
    assert balanced_accuracy(np.array([[3, 1], [0, 0]])) == pytest.approx(0.75)
    assert np.isnan(balanced_accuracy(np.zeros((2, 2))))


@pytest.mark.parametrize("seed", range(5))
def test_area_is_the_chance_that_a_positive_has_the_higher_score(seed: int):
    rng = np.random.default_rng(seed)
    values, positive = rng.integers(0, 6, 60) / 5, rng.random(60) < 0.4
    pairs = np.sign(values[positive][:, None] - values[~positive][None, :])
    assert Ranking(values, positive).area() == pytest.approx((pairs.mean() + 1) / 2)


def test_weighted_area_is_that_of_repeated_pictures():
    rng = np.random.default_rng(0)
    values, positive, times = rng.random(40).round(1), rng.random(40) < 0.5, rng.integers(0, 4, 40)
    repeated = Ranking(np.repeat(values, times), np.repeat(positive, times)).area()
    assert Ranking(values, positive).area(times.astype(float)) == pytest.approx(repeated)


def test_area_of_one_side_alone_is_unknown():
    assert np.isnan(Ranking(np.array([0.1, 0.9]), np.array([True, True])).area())
    assert np.isnan(Ranking(np.empty(0), np.empty(0, bool)).area())


def test_roc_goes_from_corner_to_corner_and_its_area_is_the_area():
    rng = np.random.default_rng(1)
    ranking = Ranking(rng.random(50), rng.random(50) < 0.5)
    false, true = ranking.curve()
    assert (false[0], true[0], false[-1], true[-1]) == (0, 0, 1, 1)
    assert np.trapezoid(true, false) == pytest.approx(ranking.area())


def test_calibration_error_is_the_mean_gap_weighted_by_pictures():
    counts, confidence, right = np.array([4.0, 6]), np.array([2.4, 5.4]), np.array([2.0, 6])
    assert calibration_error(counts, confidence, right) == pytest.approx((0.4 + 0.6) / 10)


def test_as_many_sites_are_drawn_as_there_are_some_twice_and_some_never():
    draws = site_counts(20, draws=50)
    assert draws.shape == (50, 20)
    assert (draws.sum(axis=1) == 20).all()
    assert (draws == 0).any(axis=1).all()


def test_interval_of_a_mean_is_as_wide_as_theory_says():
    values = np.random.default_rng(0).normal(0, 1, 400)
    low, high = interval(site_counts(400), lambda counts: float(counts @ values) / 400) or (0, 0)
    assert high - low == pytest.approx(2 * 1.96 / 20, rel=0.12)
    assert low < values.mean() < high


def test_one_site_has_no_interval():
    assert interval(site_counts(1), lambda counts: 1.0) is None


def test_score_of_perfect_answers():
    scores = score(answers([0.1, 0.2, 0.9, 0.8], [0, 0, 1, 1]))
    assert (scores.accuracy, scores.balanced_accuracy, scores.auc, scores.f1) == (1, 1, 1, 1)
    assert scores.confusion == ((2, 0), (0, 2))
    assert scores.calibration_error == pytest.approx(0.15)
    assert scores.accuracy_interval == (1, 1)


def test_sites_that_agree_with_themselves_widen_the_interval():
    rng = np.random.default_rng(0)
    sites = [str(i // 20) for i in range(400)]
    right_there = rng.random(20) < 0.8
    p = [0.9 if right_there[int(s)] else 0.1 for s in sites]
    together, alone = score(answers(p, [1] * 400, sites)), score(answers(p, [1] * 400))
    assert together.accuracy_interval is not None
    assert alone.accuracy_interval is not None
    width = together.accuracy_interval[1] - together.accuracy_interval[0]
    assert width > 3 * (alone.accuracy_interval[1] - alone.accuracy_interval[0])


def test_transition_pictures_are_in_no_figure_but_counted():
    scores = score(answers([0.1, 0.9, 0.9, 0.9, 0.2], [0, 1, -1, -1, -1]))
    assert (scores.n, scores.n_no_class, scores.accuracy) == (2, 3, 1.0)
    assert scores.no_class_called == pytest.approx({"none": 1 / 3, "junction": 2 / 3})


def test_groups_have_figures_of_their_own():
    scores = score(
        answers([0.1, 0.9, 0.9, 0.1], [0, 1, 0, 1], group=["day", "day", "night", "night"])
    )
    assert scores.groups["day"].accuracy == 1
    assert scores.groups["night"].accuracy == 0
    assert scores.groups["night"].auc == 0
    assert scores.accuracy == 0.5


def test_a_class_without_pictures_is_told_and_its_area_unknown():
    scores = score(answers([0.1, 0.9], [1, 1]))
    assert scores.auc is None
    assert any("no picture of class none" in note for note in scores.notes)
    assert scores.per_class["none"].recall is None


def test_more_than_two_classes():
    p = np.array([[0.8, 0.1, 0.1], [0.2, 0.7, 0.1], [0.1, 0.6, 0.3], [0.1, 0.1, 0.8]], np.float32)
    made = Answers(
        ("none", "first", "second"),
        p,
        np.array([0, 1, 2, 2]),
        np.array(list("abcd")),
        np.array(["all"] * 4),
    )
    scores = score(made)
    assert scores.confusion == ((1, 0, 0), (0, 1, 0), (0, 1, 1))
    assert scores.balanced_accuracy == pytest.approx(2.5 / 3)
    assert scores.auc == pytest.approx(1.0)


def test_nothing_to_judge_is_an_error():
    with pytest.raises(ValueError, match="nothing to judge"):
        score(answers([0.4], [-1]))


def test_arrays_that_do_not_fit_are_refused():
    with pytest.raises(ValueError, match="labels outside"):
        answers([0.4], [2])
    with pytest.raises(ValueError, match="sites"):
        answers([0.4, 0.3], [1, 0], site=["a"])
