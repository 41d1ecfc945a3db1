"""When things are due, and the real-time factor."""

import pytest

from juncnet_services.simulator.pace import Pace, RealTime

MS = 1_000_000


def test_due_at_its_rate_without_making_up() -> None:
    pace = Pace(25.0)
    assert [pace.due(t * MS) for t in (0, 10, 40, 79, 80)] == [True, False, True, False, True]
    assert pace.wait_s(90 * MS) == pytest.approx(0.030)
    assert pace.due(330 * MS)
    assert not pace.due(340 * MS)
    assert pace.wait_s(340 * MS) == pytest.approx(0.020)


def run(frame_ms: int, simulated: float) -> float:
    real_time, factor = RealTime(25.0), 1.0
    for t in range(0, 3000, 10):
        if t % frame_ms == 0:
            real_time.note_frame(t * MS)
        factor = real_time.factor(t * MS, simulated * t / 1000)
    return factor


def test_factor_is_the_worse_of_physics_and_pictures() -> None:
    assert run(40, 1.0) == pytest.approx(1.0)
    assert run(40, 0.8) == pytest.approx(0.8)
    assert run(80, 1.0) == pytest.approx(0.5, abs=0.05)
    assert run(5000, 1.0) < 0.05
