"""The subscribers of the guide hear a junction event, each in its own language, as pasted."""

import os
import re
import shutil
import socket
import subprocess
import sys
import tempfile
import threading
from collections.abc import Generator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest

import peers
from juncnet import links
from juncnet.flight import Flight, new_flight
from juncnet.launch import open_gateway
from juncnet.topics import JUNCTION_EVENT
from juncnet_services.dashboard.access import HOST, address_in
from juncnet_services.dashboard.service import Config, page_url, run
from vehicle_side import free_address

GUIDE = Path(__file__).parents[2] / "deploy/guides/subscribers.md"
PICO, NODE = "JUNCNET_ZENOH_PICO", "JUNCNET_NODE"
PUBLISHER, PAGE = "junction_navigation", "dashboard"
COUNT = 41
HEARD_S, BUILD_S = 60.0, 300.0


def program(title: str) -> str:
    """Return the program below a heading of the guide."""
    block = rf"^## {re.escape(title)}\n.*?^```\w+\n(.*?)^```"
    found = re.search(block, GUIDE.read_text(), re.DOTALL | re.MULTILINE)
    assert found is not None, title
    return found[1]


@contextmanager
def flight_with_events() -> Generator[tuple[str, Flight]]:
    """Publish an event again and again; yields the router's address and the flight."""
    with ExitStack() as stack:
        root = stack.enter_context(tempfile.TemporaryDirectory(prefix="jn-"))
        flight = new_flight("robot", (PUBLISHER, links.ROUTER, PAGE), Path(root))
        bus = stack.enter_context(peers.member(flight, PUBLISHER))
        address, ended = free_address(), threading.Event()
        stack.enter_context(open_gateway(flight, f"tcp/{address}"))

        def publish() -> None:
            index = 0
            while not ended.wait(0.2):
                event = peers.event(bus, index).model_copy(update={"count": COUNT})
                bus.publish(JUNCTION_EVENT, event)
                index += 1

        thread = threading.Thread(target=publish)
        thread.start()
        stack.callback(thread.join)
        stack.callback(ended.set)
        yield address, flight


@contextmanager
def page_of(flight: Flight) -> Generator[str]:
    """Run a dashboard that only watches; yields its address."""
    config = Config(view_only=True)
    with peers.member(flight, PAGE) as bus:
        thread = threading.Thread(target=run, args=(bus, config))
        thread.start()
        try:
            port = address_in(flight.directory).port
            assert peers.eventually(lambda: listens(port)), "the dashboard does not listen"
            yield page_url(flight.directory, config)
        finally:
            bus.stop()
            thread.join()


def listens(port: int) -> bool:
    """Return whether somebody listens on a port of this host."""
    with socket.socket() as probe:
        return probe.connect_ex((HOST, port)) == 0


def first_line(command: Sequence[str], folder: Path, **variables: str) -> str:
    """Return the first line that a program prints; it is killed then."""
    with (folder / "errors.txt").open("w+") as errors:
        process = subprocess.Popen(
            command,
            cwd=folder,
            env=os.environ | variables,
            stdout=subprocess.PIPE,
            stderr=errors,
            text=True,
        )
        limit = threading.Timer(HEARD_S, process.kill)
        limit.start()
        assert process.stdout is not None
        line = process.stdout.readline()
        limit.cancel()
        process.kill()
        process.communicate()
        errors.seek(0)
        assert line, errors.read()
    return line


def built(command: Sequence[str], folder: Path) -> None:
    """Run a compiler; what it says is what fails."""
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=BUILD_S)
    assert done.returncode == 0, done.stdout + done.stderr


def tool(name: str) -> str:
    """Return where a program is; the test is skipped where it is not installed."""
    found = shutil.which(name)
    if found is None:
        pytest.skip(f"{name} is not installed")
    return found


def folder_of(variable: str, what: str) -> Path:
    """Return the folder that a variable names; the test is skipped where it is not set."""
    if variable not in os.environ:
        pytest.skip(f"${variable} does not name a folder with {what}")
    return Path(os.environ[variable]).absolute()


def test_python(tmp_path: Path) -> None:
    (tmp_path / "events.py").write_text(program("Python"))
    with flight_with_events() as (address, _):
        line = first_line((sys.executable, "events.py", address), tmp_path)
    assert line == f"juncnet/robot/junction/event {COUNT} approached\n"


def test_c(tmp_path: Path) -> None:
    compiler, pico = tool("cc"), folder_of(PICO, "zenoh-pico")
    (tmp_path / "events.c").write_text(program("C"))
    libraries = [path for path in (pico / "lib", pico / "lib64") if path.is_dir()]
    paths = [f"-I{pico}/include", *(f"-L{path}" for path in libraries)]
    linked = [*paths, "-lzenohpico", "-lpthread", "-lrt"]
    built((compiler, "events.c", "-Wall", "-DZENOH_LINUX", *linked, "-o", "events"), tmp_path)
    with flight_with_events() as (address, _):
        where = ":".join(map(str, libraries))
        line = first_line(("./events", address), tmp_path, LD_LIBRARY_PATH=where)
    assert line.startswith("juncnet/robot/junction/event {")
    assert f'"count":{COUNT}' in line.replace(" ", "")


def typescript(title: str, folder: Path) -> None:
    """Compile a program of the guide to events.js."""
    node, compiler = tool("node"), folder_of(NODE, "TypeScript") / "node_modules"
    (folder / "events.ts").write_text(program(title))
    (folder / "package.json").write_text('{"type": "module"}')
    (folder / "node_modules").symlink_to(compiler)
    options = ("--strict", "--skipLibCheck", "--target", "es2022", "--module", "nodenext")
    script = str(compiler / "typescript/bin/tsc")
    built((node, script, *options, "--lib", "es2022,dom", "events.ts"), folder)


def test_typescript_without_zenoh(tmp_path: Path) -> None:
    typescript("TypeScript, without Zenoh", tmp_path)
    with flight_with_events() as (_, flight), page_of(flight) as page:
        line = first_line((tool("node"), "events.js", page), tmp_path)
    assert line == f"robot {COUNT} approached\n"


def test_typescript_with_zenoh_is_what_its_library_takes(tmp_path: Path) -> None:
    if not (folder_of(NODE, "TypeScript") / "node_modules/@eclipse-zenoh/zenoh-ts").is_dir():
        pytest.skip(f"${NODE} has no @eclipse-zenoh/zenoh-ts")
    typescript("TypeScript, zenoh-ts", tmp_path)
    assert "declareSubscriber" in (tmp_path / "events.js").read_text()


def test_rust(tmp_path: Path) -> None:
    cargo = tool("cargo")
    (tmp_path / "src").mkdir()
    (tmp_path / "src/main.rs").write_text(program("Rust"))
    (tmp_path / "Cargo.toml").write_text(
        '[package]\nname = "events"\nversion = "0.1.0"\nedition = "2021"\n[dependencies]\n'
        'zenoh = "1.10"\ntokio = { version = "1", features = ["macros", "rt-multi-thread"] }\n'
    )
    known = (cargo, "fetch", "--offline")
    if subprocess.run(known, cwd=tmp_path, capture_output=True, timeout=BUILD_S).returncode:
        pytest.skip("cargo does not have the crate zenoh 1.10")
    built((cargo, "build", "--offline"), tmp_path)
    with flight_with_events() as (address, _):
        line = first_line(("target/debug/events", address), tmp_path)
    assert line.startswith("juncnet/robot/junction/event {")
