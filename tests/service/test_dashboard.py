"""dashboard over the fake bus, asked over real HTTP: who may do what, and who is slow."""

import json
import logging
import socket
import struct
import threading
import time
from collections.abc import Iterator
from http.client import HTTPConnection
from pathlib import Path
from typing import Any

import pytest

from dashboards import FOLLOWER, MISSION, Dashboard, Flown, dashboard
from fakes import FakeBus
from juncnet import messages as m
from juncnet import topics as t
from juncnet_services.cli.bench.watching import Page
from juncnet_services.dashboard.access import HOST, Right, address_in, new_address
from juncnet_services.dashboard.service import Config, page_url, run
from scenes import score


@pytest.fixture(name="shown")
def _shown() -> Iterator[Dashboard]:
    with dashboard() as shown:
        yield shown


def until(condition: Any, what: str, limit_s: float = 10.0) -> None:
    deadline = time.monotonic() + limit_s
    while not condition():
        assert time.monotonic() < deadline, what
        time.sleep(0.01)


def test_the_service_serves_what_it_hears_until_the_bus_stops(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    told: list[Any] = []

    def look(bus: FakeBus) -> None:
        address = address_in(tmp_path)
        link = HTTPConnection(HOST, address.port, timeout=10)
        headers = {"Authorization": f"Bearer {address.watch_key}"}
        link.request("GET", "/state?after=0", headers=headers)
        told.append(json.loads(link.getresponse().read()))
        link.close()

    script = [(t.JUNCTION_SCORE, score(1.0, 0.75)), 0.1, 0.1, look]
    with caplog.at_level(logging.INFO):
        run(FakeBus(script, "dashboard", tmp_path), Config(picture_rate_hz=5))
    assert told[0]["robots"]["robot"]["scores"] == [[1.0, 0.75]]
    assert told[0]["picture_rate_hz"] == 5
    assert told[0]["may_command"] is False
    assert page_url(tmp_path, Config()) in caplog.text
    watch = page_url(tmp_path, Config(view_only=True))
    assert watch == address_in(tmp_path).url(Right.WATCH)


def test_the_page_is_given_to_anyone_here_and_nothing_else_is(shown: Dashboard) -> None:
    for path, kind in (("/", "text/html"), ("/main.js", "text/javascript"), ("/style.css", "text")):
        status, headers, body = shown.ask("GET", path, Authorization="")
        assert (status, headers["Content-Type"].startswith(kind)) == (200, True)
        assert "default-src 'none'" in headers["Content-Security-Policy"]
        assert body
    for path in ("/state", "/still?robot=robot", "/models"):
        assert shown.ask("GET", path, Authorization="")[0] == 403
        assert shown.ask("GET", path, Authorization="Bearer nonsense")[0] == 403
    for path in ("/nothing", "/../service.py", "/..%2fservice.py", "//etc/passwd"):
        assert shown.ask("GET", path)[0] == 404


@pytest.mark.parametrize(
    "headers",
    [
        {"Host": "evil.example"},
        {"Host": "evil.example:80", "Origin": "http://evil.example:80"},
        {"Origin": "http://evil.example"},
        {"Origin": "null"},
        {"Sec_Fetch_Site": "cross-site"},
        {"Authorization": ""},
    ],
)
def test_another_page_in_the_same_browser_reaches_nothing(
    shown: Dashboard, headers: dict[str, str]
) -> None:
    Flown(shown.bus).step()
    shown.hear()
    for method, path, body in (
        ("POST", "/ask", {"robot": "robot", "do": "hold"}),
        ("GET", "/state", None),
    ):
        status, _, answer = shown.ask(method, path, body, **headers)
        assert status == 403
        assert json.loads(answer)["accepted"] is False
    assert not shown.bus.orders


def test_a_form_cannot_order_and_a_large_body_is_not_read(shown: Dashboard) -> None:
    order = b'{"robot": "robot", "do": "hold"}'
    assert shown.ask("POST", "/ask", order, Content_Type="text/plain")[0] == 404
    assert shown.ask("POST", "/ask", order, Content_Type="")[0] == 404
    assert shown.ask("POST", "/ask", b"x" * 70_000)[0] == 413
    assert shown.ask("POST", "/ask", b"{}")[0] == 400
    assert shown.ask("PUT", "/ask", order)[0] == 501
    assert not shown.bus.orders


def test_a_key_to_watch_and_a_page_to_watch_command_nothing(shown: Dashboard) -> None:
    order = {"robot": "robot", "do": "hold"}
    watch = f"Bearer {shown.address.watch_key}"
    assert shown.ask("GET", "/state", Authorization=watch)[0] == 200
    assert shown.ask("POST", "/ask", order, Authorization=watch)[0] == 403
    with dashboard(view_only=True) as looking:
        Flown(looking.bus).step()
        assert looking.state()["may_command"] is False
        assert looking.ask("POST", "/ask", order)[0] == 403
        assert not looking.bus.orders
    assert not shown.bus.orders


def ask(shown: Dashboard, **body: Any) -> m.Reply:
    status, _, answer = shown.ask("POST", "/ask", {"robot": "robot", **body})
    assert status == 200
    return m.Reply.model_validate_json(answer)


def test_orders_and_requests_reach_the_robot_and_its_answer_comes_back(shown: Dashboard) -> None:
    Flown(shown.bus, "other").step()
    Flown(shown.bus).step()
    until(lambda: set(shown.state()["robots"]) == {"robot", "other"}, "both robots are known")
    for do in ("hold", "resume", "land"):
        reply = ask(shown, do=do)
        assert reply.accepted
        assert reply.reason.startswith("as ordered (")
    assert [(r, o.kind.value) for r, o, _ in shown.bus.orders] == [
        ("robot", "hold"),
        ("robot", "resume"),
        ("robot", "land"),
    ]
    assert {order.operator for _, order, _ in shown.bus.orders} == {"dashboard"}
    ask(shown, do="mission", mission=MISSION.model_dump(mode="json"))
    ask(shown, do="model", model="juncnet")
    ask(shown, do="model", model="/elsewhere/x.onnx")
    ask(shown, do="follower", follower=FOLLOWER, robot="other")
    robots, asked = zip(*shown.bus.requests, strict=True)
    assert robots == ("robot", "robot", "robot", "other")
    assert asked[0] == m.SetMission(mission=MISSION)
    assert asked[1].path.endswith("models/juncnet.onnx")
    assert asked[2] == m.LoadModel(path="/elsewhere/x.onnx")
    assert asked[3] == m.LoadFollower(follower=FOLLOWER)


def test_a_refusal_and_a_silence_are_told_as_they_are(shown: Dashboard) -> None:
    assert "no robot 'robot'" in ask(shown, do="hold").reason
    Flown(shown.bus).step()
    until(lambda: shown.state()["robots"], "the robot is known")
    shown.bus.refusal = "the battery is low"
    refused = ask(shown, do="resume")
    assert not refused.accepted
    assert refused.reason.startswith("the battery is low")
    shown.bus.mute = True
    unanswered = ask(shown, do="hold")
    assert not unanswered.accepted
    assert "NO ANSWER" in unanswered.reason
    assert len(shown.bus.orders) >= 5  # the refused one, and one a tenth of a second since


def test_pictures_are_ordered_only_while_a_page_asks_for_them(shown: Dashboard) -> None:
    robot = Flown(shown.bus)
    robot.step()
    shown.hear()
    assert not shown.bus.subscribed(t.CAMERA_IMAGE)
    assert shown.ask("GET", "/still?robot=robot")[0] == 204
    until(lambda: shown.bus.subscribed(t.CAMERA_IMAGE), "a page asks for pictures")
    robot.step()
    until(lambda: shown.ask("GET", "/still?robot=robot")[0] == 200, "there is a picture")
    body = shown.ask("GET", "/still?robot=robot")[2]
    head = json.loads(body[4 : 4 + struct.unpack_from("<I", body)[0]])
    again = f"/still?robot=robot&epoch={head['epoch']}&sequence={head['sequence']}"
    assert shown.ask("GET", again)[0] == 204
    assert shown.ask("GET", "/still?robot=nobody")[0] == 204
    until(lambda: not shown.bus.subscribed(t.CAMERA_IMAGE), "nobody asks any more")


def test_the_benchmarks_page_asks_for_what_is_new(shown: Dashboard) -> None:
    robot = Flown(shown.bus)
    with Page(shown.address, "robot") as page:
        assert not page.ask_picture()
        until(lambda: shown.bus.subscribed(t.CAMERA_IMAGE), "a page asks for pictures")
        robot.step()
        until(page.ask_picture, "there is a picture")
        assert not page.ask_picture()
        robot.step()
        until(page.ask_picture, "there is another one")
        assert page.ask_state()
    with Page(new_address(), "robot") as nobody:
        assert not nobody.ask_state()
        assert not nobody.ask_picture()


def test_a_browser_that_does_not_read_delays_nobody(shown: Dashboard) -> None:
    robot = Flown(shown.bus)
    robot.step()
    until(lambda: shown.state()["robots"], "the robot is known")
    request = (
        f"GET /state HTTP/1.1\r\nHost: {shown.address.hosts[0]}\r\n"
        f"Authorization: Bearer {shown.address.watch_key}\r\n\r\n"
    ).encode()
    with socket.create_connection((HOST, shown.address.port)) as slow:
        slow.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        slow.setblocking(False)
        try:
            while True:  # until neither side's buffers take any more
                slow.send(request * 100)
        except BlockingIOError:
            pass
        began = time.monotonic()
        assert ask(shown, do="hold").accepted
        assert time.monotonic() - began < 5.0
    assert threading.active_count() < 20


def test_more_connections_than_there_is_room_for_are_closed(shown: Dashboard) -> None:
    idle = [socket.create_connection((HOST, shown.address.port)) for _ in range(64)]
    try:
        with socket.create_connection((HOST, shown.address.port), timeout=10) as late:
            assert late.recv(1) == b""
    finally:
        for link in idle:
            link.close()
    until(lambda: _served(shown), "there is room again")


def _served(shown: Dashboard) -> bool:
    try:
        return shown.ask("GET", "/")[0] == 200
    except OSError:
        return False
