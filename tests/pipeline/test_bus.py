"""The Zenoh bus between real processes: every quality of service, requests, deaths, outsiders."""

import signal
import socket
import subprocess
import sys
import time
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import zenoh

import peers
from juncnet import topics as t
from juncnet.flight import Flight
from juncnet.launch import connect, open_gateway
from juncnet.layout import SAVED
from juncnet.messages import Health, JpegImage, LoadModel, Mission, Reply, SetMission
from juncnet.zenoh_bus import ZenohBus


@pytest.fixture(name="flight")
def _flight() -> Iterator[Flight]:
    with peers.a_flight() as flight:
        yield flight


@pytest.fixture(name="bus")
def _bus(flight: Flight) -> Iterator[ZenohBus]:
    with peers.member(flight, "beta") as bus:
        yield bus


def errors(bus: ZenohBus) -> int:
    return bus.health.report(bus.stamp(), bus.flight, 0, 0).errors


def test_commands_events_and_kept_state_reach_a_late_joiner(flight: Flight, bus: ZenohBus) -> None:
    with peers.started("talk", flight, "alpha"):
        assert bus.subscribe(t.COMMAND_VELOCITY).take(10.0) is not None
        kept, events = bus.subscribe(t.NAVIGATION_STATE), bus.subscribe(t.JUNCTION_EVENT, 64)
        state = kept.take(10.0)
        assert state is not None
        assert state.count == 7
        received = [events.take(10.0) for _ in range(5)]
        assert [e.index if e else None for e in received] == [0, 1, 2, 3, 4]
        assert events.take(0.3) is None  # none twice


def test_an_inbox_that_does_not_wake_is_filled_without_ending_a_wait(
    flight: Flight, bus: ZenohBus
) -> None:
    quiet = bus.subscribe(t.COMMAND_VELOCITY, wakes=False)
    with peers.started("talk", flight, "alpha"):
        assert peers.eventually(lambda: quiet.newest is not None)
        assert not bus.wait(0.2)
        assert quiet.take() is not None


def test_commands_flow_again_after_kill_and_restart(flight: Flight, bus: ZenohBus) -> None:
    commands = bus.subscribe(t.COMMAND_VELOCITY)
    epochs: set[int] = set()
    for _ in range(3):
        with peers.started("talk", flight, "alpha") as process:
            assert peers.eventually(lambda: _new_epoch(commands.take(1.0), epochs))
            process.send_signal(signal.SIGKILL)
    assert len(epochs) == 3


def _new_epoch(command: object, epochs: set[int]) -> bool:
    epoch = command.issued.epoch if isinstance(command, t.COMMAND_VELOCITY.message) else 0
    if epoch == 0 or epoch in epochs:
        return False
    epochs.add(epoch)
    return True


def test_the_death_of_one_cuts_nobody_else(flight: Flight, bus: ZenohBus) -> None:
    with (
        peers.started("talk", flight, "alpha"),
        peers.started("write_frames", flight, "gamma") as other,
    ):
        commands = bus.subscribe(t.COMMAND_VELOCITY)
        assert commands.take(10.0) is not None
        assert peers.eventually(lambda: bus.alive() == {"alpha", "gamma"})
        other.kill()
        for _ in range(20):
            assert commands.take(0.5) is not None
        assert peers.eventually(lambda: bus.alive() == {"alpha"})


def test_requests_are_answered_refused_and_time_out(flight: Flight, bus: ZenohBus) -> None:
    mission = SetMission(mission=Mission(name="survey"))
    with peers.started("talk", flight, "alpha"):
        reply = bus.request(t.MISSION_SET, mission, 10.0)
        assert reply == Reply(accepted=True, reason="survey")
        answers = bus.session.get(t.MISSION_SET.expression("robot"), payload=b"{}", timeout=5.0)
        texts = [a.ok.payload.to_bytes() for a in answers if a.ok is not None]
        refused = Reply.decode(texts[0])
        assert not refused.accepted
        assert "SetMission.mission" in refused.reason
    started = time.monotonic()
    nobody = bus.request(t.MODEL_LOAD, LoadModel(path="/m.onnx"), 0.3)
    assert not nobody.accepted
    assert "junction_inference" in nobody.reason
    assert time.monotonic() - started < 2.0


def test_a_handler_that_raises_is_a_refusal(flight: Flight, bus: ZenohBus) -> None:
    def broken(_request: LoadModel) -> Reply:
        raise RuntimeError("no such model")

    bus.serve(t.MODEL_LOAD, broken)
    with peers.member(flight, "alpha") as asker:
        reply = asker.request(t.MODEL_LOAD, LoadModel(path="/m.onnx"))
        assert reply == Reply(accepted=False, reason="no such model")
        assert errors(bus) == 1


def test_wanted_follows_the_subscribers(flight: Flight, bus: ZenohBus) -> None:
    assert not bus.wanted(t.CAMERA_IMAGE)
    with peers.member(flight, "alpha") as viewer:
        pictures = viewer.subscribe(t.CAMERA_IMAGE)
        assert peers.eventually(lambda: bus.wanted(t.CAMERA_IMAGE))
        image = JpegImage.of(b"\xff\xd8rest", header=bus.stamp(), width=4, height=2)
        bus.publish(t.CAMERA_IMAGE, image)
        received = pictures.take(5.0)
        assert received == image
        assert received is not None
        assert bytes(received.payload) == b"\xff\xd8rest"
    assert peers.eventually(lambda: not bus.wanted(t.CAMERA_IMAGE))


TOPICS = [topic for topic in t.TOPICS if isinstance(topic, t.Topic)]


@pytest.mark.parametrize("payload", [b"", b"\xff\xfe", b"{}", b'{"header": NaN}', b"[1]" * 9])
def test_malformed_payloads_are_counted_on_every_key(
    flight: Flight, bus: ZenohBus, payload: bytes
) -> None:
    inboxes = [bus.subscribe(topic) for topic in TOPICS]
    with peers.member(flight, "alpha") as sender:
        assert peers.eventually(lambda: sender.wanted(t.CAMERA_IMAGE))
        assert peers.eventually(lambda: sender.wanted(t.VEHICLE_STATE))
        for topic in TOPICS:
            put_raw(sender, topic.expression("robot"), payload)
        assert peers.eventually(lambda: errors(bus) == len(TOPICS))
    assert not any(inbox.take() for inbox in inboxes)


def put_raw(bus: ZenohBus, key: str, payload: bytes) -> None:
    session: Any = bus.session
    session.put(key, payload)


def test_health_is_published_with_what_was_dropped(flight: Flight, bus: ZenohBus) -> None:
    with peers.member(flight, "alpha") as other:
        reports = other.subscribe(t.health_topic("*"), 8)
        bus.subscribe(t.COMMAND_VELOCITY)
        with peers.started("talk", flight, "gamma"):
            bus.report_health()
            bus.health.set("lost", 3)
            bus.health.output(bus.clock.now_ns() - 5_000_000, bus.stamp())
            by_service: dict[str, Health] = {}
            assert peers.eventually(
                lambda: _note(reports.take(1.0), by_service) and by_service["beta"].drops > 10
            )
        health = by_service["beta"]
        assert health.counters == {"lost": 3.0}
        assert health.flight == flight.id


def _note(health: object, by_service: dict[str, Health]) -> bool:
    if isinstance(health, Health):
        by_service[health.service] = health
    return "beta" in by_service


def test_one_subscriber_watches_all_robots(flight: Flight, bus: ZenohBus) -> None:
    inbox = bus.subscribe(t.COMMAND_ACK, 4, robot="*")
    events = bus.subscribe(t.JUNCTION_EVENT, 2, robot="*")
    for index in range(3):
        for robot in ("one", "two"):
            bus.publish(t.JUNCTION_EVENT, peers.event(bus, index), robot=robot)
    seen: list[tuple[str, int]] = []
    assert peers.eventually(
        lambda: bool(seen.extend((r, e.index) for r, e in events.drain())) or len(seen) >= 4
    )
    assert {robot for robot, _ in seen} == {"one", "two"}
    assert inbox.drain() == []


@contextmanager
def _gateway(flight: Flight) -> Generator[str]:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        address = f"127.0.0.1:{probe.getsockname()[1]}"
    with open_gateway(flight, f"tcp/{address}"):
        yield address


def test_outsiders_hear_everything_once_and_may_ask(flight: Flight) -> None:
    with (
        peers.started("talk", flight, "alpha"),
        _gateway(flight) as address,
        connect(address) as outsider,
    ):
        commands = outsider.subscribe(t.COMMAND_VELOCITY, 1000)
        events = outsider.subscribe(t.JUNCTION_EVENT, 64)
        assert commands.take(10.0) is not None
        sequences = [c.issued.sequence for c in (commands.take(1.0) for _ in range(50)) if c]
        assert sequences == list(range(sequences[0], sequences[0] + 50))
        received = [events.take(5.0) for _ in range(5)]
        assert [e.index if e else None for e in received] == [0, 1, 2, 3, 4]
        reply = outsider.request(t.MISSION_SET, SetMission(mission=Mission(name="x")))
        assert reply.accepted


def test_an_outsider_gets_no_frames_and_leaves_its_working_directory_alone(
    flight: Flight, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    own = tmp_path / "iox" / "mine.txt"
    own.parent.mkdir()
    own.write_text("mine")
    (tmp_path / SAVED).write_text("{}")
    with (
        peers.started("write_frames", flight, "alpha", "zenoh"),
        _gateway(flight) as address,
        connect(address) as outsider,
    ):
        assert outsider.subscribe(t.health_topic("*")).take(10.0) is not None
        with outsider.frames_in(t.CAMERA_FRAME).take(0.5) as frame:
            assert frame is None
        assert not (outsider.flight_dir / SAVED).exists()
    assert own.read_text() == "mine"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["iox", SAVED]


def test_a_tool_joins_by_the_flight_directory(flight: Flight) -> None:
    with pytest.raises(ConnectionError, match="no process"):
        connect(flight.directory, timeout_s=0.2)
    with pytest.raises(ConnectionError, match="neither a flight's directory nor HOST:PORT"):
        connect(flight.directory / "nowhere")
    with pytest.raises(
        ConnectionError, match=r"^127\.0\.0\.1:9: no router lets .* does the flight"
    ):
        connect("127.0.0.1:9")
    with pytest.raises(ConnectionError, match=r"^127\.0\.0\.1:9: no router"):
        connect("tls/127.0.0.1:9")
    with peers.started("talk", flight, "alpha"), connect(flight.directory, timeout_s=10) as tool:
        assert tool.robot == flight.robot
        assert tool.subscribe(t.COMMAND_VELOCITY).take(10.0) is not None


def test_the_router_service_lets_plain_zenoh_in(flight: Flight) -> None:
    directory = flight.directory.parent / "second"
    command = [sys.executable, "-m", "juncnet_services.router", "--layout", "local"]
    process = subprocess.Popen([*command, "--flight-dir", str(directory)])
    try:
        note = directory / "router.endpoint"
        assert peers.eventually(note.exists)
        settings = f'{{mode: "client", connect: {{endpoints: ["tcp/{note.read_text().strip()}"]}}}}'
        heard: list[str] = []
        with zenoh.open(zenoh.Config.from_json5(settings)) as session:
            key = "juncnet/*/health/router"
            session.declare_subscriber(key, lambda s: heard.append(s.payload.to_string()))
            assert peers.eventually(lambda: len(heard) > 0)
        process.send_signal(signal.SIGTERM)
        assert process.wait(5.0) == 0
    finally:
        process.kill()
        process.wait()


def test_a_publisher_rests_once_its_only_subscriber_has_unsubscribed(flight: Flight) -> None:
    with peers.member(flight, "alpha") as sender, peers.member(flight, "beta") as receiver:
        inbox = receiver.subscribe(t.CAMERA_IMAGE)
        assert peers.eventually(lambda: sender.wanted(t.CAMERA_IMAGE))
        receiver.unsubscribe(inbox)
        assert peers.eventually(lambda: not sender.wanted(t.CAMERA_IMAGE))
        again = receiver.subscribe(t.CAMERA_IMAGE)
        assert peers.eventually(lambda: sender.wanted(t.CAMERA_IMAGE))
        image = JpegImage.of(b"\xff\xd8", header=sender.stamp(), width=2, height=2)
        sender.publish(t.CAMERA_IMAGE, image)
        assert again.take(10.0) == image
        assert inbox.newest is None
