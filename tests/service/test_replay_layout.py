"""A replay runs the services of the recorded layout, and reaches no vehicle."""

from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import cast

from juncnet.assets import asset
from juncnet.layout import SAVED, LinksOptions, load_layout
from juncnet.recording.reader import Recorded, Recording
from juncnet_services.cli.replay_play import recorded_layout


def _nothing(keys: list[str]) -> Iterator[Recorded]:
    del keys
    return iter(())


def test_a_laptops_recording_is_replayed_without_its_links_to_the_vehicle(tmp_path: Path) -> None:
    settings = ["links.vehicle=127.0.0.1:7447", "links.video=127.0.0.1:7448"]
    load_layout(asset("layouts/laptop.toml"), settings).save(tmp_path / SAVED)
    text = (tmp_path / SAVED).read_text()
    recording = SimpleNamespace(layout=text, files=[], messages=_nothing)
    replayed = recorded_layout(cast(Recording, recording), tmp_path, [])
    assert "junction_navigation" in replayed.processes
    assert replayed.links == LinksOptions()
