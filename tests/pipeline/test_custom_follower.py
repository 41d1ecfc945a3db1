"""A road follower from outside the package: it flies, it fails, it hangs."""

import os
from pathlib import Path

import pytest

from flights import SMALL_CAMERA, Flying
from juncnet.topics import COMMAND_VELOCITY, ROAD_COMMAND
from juncnet_services.cli.demo import prepare

MODULE = '''
"""A follower of somebody else."""
import time
from pathlib import Path

import numpy as np

from juncnet.messages import Velocity
from juncnet_services.road_following.follower import Proposal


class Grey:
    """Steers to where the lower half of the picture is most like what lies straight ahead."""

    def __init__(self, options):
        self.speed_mps = options["speed_mps"]
        self.raises, self.hangs = Path(options["raises"]), Path(options["hangs"])

    def follow(self, frame, state):
        if self.raises.exists():
            raise RuntimeError("cannot see the road")
        if self.hangs.exists():
            self.hangs.unlink()
            time.sleep(3600)
        rows = frame.luminance()[frame.layout.height * 3 // 4 :: 4, ::8].astype(np.float32)
        columns = np.linspace(1.0, -1.0, rows.shape[1], dtype=np.float32)
        here = np.median(rows[:, np.abs(columns) < 0.1])
        alike = np.exp(-(((rows - here) / 12) ** 2)) * np.exp(-((columns / 0.5) ** 2))
        left = float((alike * columns).sum() / alike.sum())
        return Proposal(Velocity(forward_mps=self.speed_mps, yaw_rate_radps=0.8 * left), 0.9)
'''
SPEED_MPS = 1.3
TIME_LIMIT_S = 2.0


@pytest.fixture
def flying(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Flying:
    """Return a flight with the follower of `MODULE`, not started yet."""
    (tmp_path / "outsider.py").write_text(MODULE)
    path = os.environ.get("PYTHONPATH", "")
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}{os.pathsep}{path}".rstrip(os.pathsep))
    options = f'speed_mps={SPEED_MPS}, raises="{folder}/raises", hangs="{folder}/hangs"'
    settings = (
        *SMALL_CAMERA,
        'road_following.follower="outsider:Grey"',
        f"road_following.options={{{options}}}",
        'road_following.source="outsider"',
        f"road_following.time_limit_s={TIME_LIMIT_S}",
        'junction_navigation.road_source="outsider"',
    )
    return Flying(prepare("copter", None, 5, None, settings))


def test_it_flies(flying: Flying) -> None:
    with flying:
        roads = flying.bus.subscribe(ROAD_COMMAND, 1000)
        commands = flying.bus.subscribe(COMMAND_VELOCITY, 2000)
        truths = flying.moves(10.0)
        far = max(abs(t.pose.x_m - truths[0].pose.x_m) for t in truths)
        far += max(abs(t.pose.y_m - truths[0].pose.y_m) for t in truths)
        assert far > 5.0
        assert {road.source for _, road in roads.drain()} == {"outsider"}
        forward = [command.velocity.forward_mps for _, command in commands.drain()]
        assert max(forward) == pytest.approx(SPEED_MPS, abs=0.05)


def test_it_fails_and_hangs_and_the_robot_holds(flying: Flying, folder: Path) -> None:
    raises, hangs = folder / "raises", folder / "hangs"
    with flying:
        flying.moves(2.0)
        flying.all_report()
        first = flying.pids["road_following"]
        raises.touch()
        flying.stands(1.0)
        said = "follower failed: RuntimeError: cannot see the road"
        flying.until(lambda: said in flying.last_errors["road_following"], "the failure is told")
        assert flying.errors["road_following"] > 0
        raises.unlink()
        flying.moves(2.0)
        assert flying.pids["road_following"] == first
        hangs.touch()
        flying.until(lambda: not hangs.exists(), "the follower hangs")
        flying.stands(0.5)
        flying.until(lambda: flying.pids["road_following"] != first, "the process is another one")
        flying.moves(2.0)
        assert flying.demo.supervisor.restarts()["road_following"] == 1
        others = [n for n in flying.flight.processes if n != "road_following"]
        assert {flying.demo.supervisor.restarts()[name] for name in others} == {0}
        log = (flying.flight.directory / "road_following.log").read_text()
        assert "follower outsider:Grey hung" in log
