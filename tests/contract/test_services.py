"""Every service has the same shape: contract, Config, run, main, a test, a place in a layout."""

import ast
import importlib
import re
from pathlib import Path

import pytest
from pydantic import BaseModel

import juncnet_services
from juncnet.assets import asset_path
from juncnet.layout import load_layout, service_config
from juncnet.topics import SERVICES, TOPICS

PACKAGE = Path(juncnet_services.__file__).parent
TESTS = Path(__file__).parents[1]
PROCESSES = (*SERVICES, "simulator", "router", "recorder", "dashboard")
SHELL_LINES = 80
LOOP_LINES = 15


def source(service: str) -> str:
    return (PACKAGE / service / "service.py").read_text()


@pytest.mark.parametrize("service", PROCESSES)
def test_it_has_the_four_blocks(service: str) -> None:
    module = importlib.import_module(f"juncnet_services.{service}.service")
    first = (module.__doc__ or "").splitlines()[0]
    assert re.match(rf"{service}: \S.* -> \S.*\.$", first), first
    config = service_config(service)
    assert issubclass(config, BaseModel)
    assert config.model_config.get("extra") == "forbid"
    assert config.model_config.get("frozen") is True
    assert callable(module.run)
    assert "launch(run, Config)" in source(service)
    assert (PACKAGE / service / "__main__.py").exists()


@pytest.mark.parametrize("service", PROCESSES)
def test_its_shell_is_short(service: str) -> None:
    assert len(source(service).splitlines()) < SHELL_LINES
    loops = [n for n in ast.walk(ast.parse(source(service))) if isinstance(n, (ast.While, ast.For))]
    for loop in loops:
        assert (loop.end_lineno or 0) - loop.lineno < LOOP_LINES


@pytest.mark.parametrize("service", SERVICES)
def test_it_has_a_test_with_a_fake_bus(service: str) -> None:
    text = (TESTS / "service" / f"test_{service}.py").read_text()
    assert "FakeBus" in text
    assert f"juncnet_services.{service}.service" in text


@pytest.mark.parametrize("name", ["local", "rover", "video"])
def test_shipped_layouts_are_valid_and_complete(name: str) -> None:
    layout = load_layout(asset_path(name, "layouts", ".toml"))
    layout.validate_all()
    assert set(SERVICES) <= set(layout.processes)


@pytest.mark.parametrize("drone", ["drone", "drone_simulated"])
def test_the_two_sides_of_the_split_are_valid_and_complete_together(drone: str) -> None:
    sides = [load_layout(asset_path(name, "layouts", ".toml")) for name in (drone, "laptop")]
    for layout in sides:
        layout.validate_all()
    processes = [set(layout.processes) for layout in sides]
    assert set(SERVICES) <= processes[0] | processes[1]
    assert "router" in processes[0] - processes[1]


def test_keys_stand_in_the_table_only() -> None:
    keys = [topic.key for topic in TOPICS]
    root = Path(juncnet_services.__file__).parents[2]
    for path in [*root.glob("shared/**/*.py"), *root.glob("services/**/*.py")]:
        if path.name == "topics.py":
            continue
        strings = {
            node.value
            for node in ast.walk(ast.parse(path.read_text()))
            if isinstance(node, ast.Constant) and isinstance(node.value, str)
        }
        assert not strings & set(keys), path


def test_zenoh_is_imported_in_few_places_only() -> None:
    root = Path(juncnet_services.__file__).parents[2]
    importers = {
        path.name
        for path in [*root.glob("shared/**/*.py"), *root.glob("services/**/*.py")]
        if re.search(r"^\s*(import|from) zenoh", path.read_text(), re.MULTILINE)
    }
    assert {name for name in importers if not name.startswith("zenoh_")} <= {"launch.py"}
