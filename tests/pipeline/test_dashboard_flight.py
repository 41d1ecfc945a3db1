"""The page over a real flight of all processes: watched to its summary, stopped, a model swapped.

`JUNCNET_SCREENSHOTS=DIR` keeps pictures of it.
"""

import os
import time
from pathlib import Path
from typing import Any

import onnx
import pytest

from browser import Browser, needs_chromium
from flights import Flying
from juncnet.assets import asset
from juncnet.clocks import NS_PER_S
from juncnet.messages import Mission, Turn
from juncnet.modelfile import PROPERTY, ModelMetadata
from juncnet_services.cli.demo import DASHBOARD, prepare
from juncnet_services.cli.link_tap import LinkTap
from juncnet_services.dashboard.access import Right, address_in

pytestmark = [needs_chromium, pytest.mark.full]
FIRST_HOLD_S = 0.3
FLIGHT_S = 150.0


def renamed_model(path: Path, name: str) -> Path:
    """Write the shipped model under another name, and return its path."""
    # onnx leaves parts of its own functions untyped
    load: Any = onnx.load  # pyright: ignore[reportUnknownMemberType, reportUnknownVariableType]
    save: Any = onnx.save  # pyright: ignore[reportUnknownMemberType, reportUnknownVariableType]
    model = load(str(asset("models/juncnet.onnx")))
    for entry in model.metadata_props:
        if entry.key == PROPERTY:
            metadata = ModelMetadata.model_validate_json(entry.value)
            entry.value = metadata.model_copy(update={"name": name}).model_dump_json()
    save(model, str(path))
    return path


def shoot(browser: Browser, name: str) -> None:
    """Keep pictures in both sizes and themes, if they are wanted."""
    folder = os.environ.get("JUNCNET_SCREENSHOTS")
    if not folder:
        return
    for scheme in ("light", "dark"):
        browser.run(f"document.documentElement.dataset.theme = '{scheme}'")
        for width, height in ((1280, 800), (390, 844)):
            browser.resize(width, height)
            time.sleep(1.0)
            browser.picture(Path(folder) / f"{name}-{scheme}-{width}.png")
    browser.run("document.documentElement.dataset.theme = 'light'")
    browser.resize(1280, 800)


def test_a_flight_is_watched_stopped_and_finished_with_another_model(
    folder: Path, tmp_path: Path
) -> None:
    model = renamed_model(tmp_path / "second.onnx", "second")
    turns = (Turn(at=1, turn="right"), Turn(at=2, turn="left"))
    mission = Mission(name="right_left", turns=turns, finish_after=2)
    setup = prepare("copter", seed=3, mission=mission)
    with Flying(setup, (DASHBOARD,)) as flying, Browser() as browser:
        flying.all_report()
        browser.open(address_in(flying.flight.directory).url(Right.COMMAND))
        browser.until_text("#events", "Junction 1 ahead", FLIGHT_S)
        browser.until_text("#events", "Left junction 1", FLIGHT_S)
        shoot(browser, "flight")

        browser.press("s")
        browser.run(f"document.getElementById('model').value = '{model}'")
        browser.click("#loadmodel")
        browser.until_text("#swapper", "now second")
        browser.press("Escape")

        with LinkTap(flying.flight.directory) as tap:
            browser.until("document.querySelector('.pill.good')")
            flying.until(lambda: any(not told.holds for told in tap.told), "the robot flies")
            pressed_ns = time.monotonic_ns()
            browser.press(" ")
            flying.until(
                lambda: any(told.holds and told.ns > pressed_ns for told in tap.told), "a hold"
            )
            first = next(told for told in tap.told if told.holds and told.ns > pressed_ns)
            took_s = (first.ns - pressed_ns) / NS_PER_S
            print(f"stop pressed to first hold at the vehicle: {1e3 * took_s:.0f} ms")
            assert took_s < FIRST_HOLD_S
            browser.until_text("#status", "STOPPED")
            shoot(browser, "stopped")
            flying.stands(0.5)
            browser.press("r")
            browser.press("r")
            browser.until_text("#answer", "Resume: done")

            browser.until("document.getElementById('summary').open", FLIGHT_S)
            assert "junctions counted\n2" in browser.text("#summary").replace("\n\n", "\n")
            shoot(browser, "summary")
            events = browser.text("#events")
            for text in ("model: second instead of juncnet", "hold obeyed", "resume obeyed"):
                assert text in events
        assert browser.problems == []
