"""Bytes from outside, damaged: every decoder understands them or refuses them as it says."""

import pytest

from decoders import TARGETS
from fuzz import attack


@pytest.mark.parametrize("name", TARGETS)
def test_what_is_whole_is_understood(name: str) -> None:
    target = TARGETS[name]
    assert all(target.run(seed) for seed in target.seeds)


@pytest.mark.parametrize("count", [1000, pytest.param(100_000, marks=pytest.mark.full)])
@pytest.mark.parametrize("name", TARGETS)
def test_what_is_damaged_is_survived(name: str, count: int) -> None:
    assert attack(TARGETS[name], count, seed=7)["understood"] < count
