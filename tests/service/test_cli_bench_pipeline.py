"""The pipeline called in one process, and latencies told from messages."""

from pathlib import Path

import pytest

from juncnet.assets import asset_path
from juncnet.features import Preprocessing
from juncnet.layout import load_layout
from juncnet.topics import SERVICES
from juncnet_services.cli.bench.in_process import Pipeline, pictures
from juncnet_services.cli.bench.measured import Latencies, children_of, cpu_s
from scenes import stamp, tiny_model


def test_every_stage_is_called_and_timed(tmp_path: Path) -> None:
    model = tiny_model(tmp_path / "model.onnx", preprocessing=Preprocessing())
    settings = (
        f'junction_inference.model="{model}"',
        "simulator.width=320",
        "simulator.height=180",
        'road_following.options={mask="colour"}',
    )
    layout = load_layout(asset_path("local", "layouts", ".toml"), settings)
    frames, taken = pictures(layout, 2)
    assert (frames.width, frames.height) == (320, 180)
    assert (taken[0] != taken[1]).any()
    pipeline = Pipeline(layout)
    times_ms = pipeline.step(frames, taken[0])
    assert tuple(times_ms) == SERVICES
    assert all(ms > 0 for ms in times_ms.values())
    assert pipeline.errors == []


def test_a_command_is_complete_once_score_and_road_are_heard() -> None:
    latencies = Latencies()
    whole, half = stamp(1.0), stamp(2.0)
    latencies.score(whole, round(1.004e9))
    latencies.command(whole, round(1.005e9))
    latencies.road(whole, round(1.010e9))
    latencies.command(whole, round(1.0095e9))
    latencies.command(whole, round(1.040e9))
    latencies.score(half, round(2.004e9))
    latencies.command(half, round(2.005e9))
    assert latencies.complete_ms() == pytest.approx([9.5])
    assert latencies.first_ms() == pytest.approx([5.0, 5.0])
    assert latencies.pictures == (2, 1, 2)


def test_a_process_that_has_ended_uses_nothing() -> None:
    assert cpu_s(2**22 + 1) == 0.0
    assert children_of(2**22 + 1) == []
    assert cpu_s(1) >= 0.0
