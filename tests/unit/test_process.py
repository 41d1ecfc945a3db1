"""What a process tells of itself."""

import time
from pathlib import Path

import pytest

from juncnet.flight import Flight
from juncnet.process import ServiceProcess


def test_a_restarted_process_has_a_newer_epoch_even_if_the_wall_clock_was_set_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    flight = Flight("f", tmp_path, "r", ("router",))
    epochs: list[int] = []
    for wall_ns in (2_000_000_000, 1_000_000_000):
        monkeypatch.setattr(time, "time_ns", lambda wall_ns=wall_ns: wall_ns)
        epochs.append(ServiceProcess(flight, "frame_capture", tmp_path).epoch)
    assert epochs[0] < epochs[1]
