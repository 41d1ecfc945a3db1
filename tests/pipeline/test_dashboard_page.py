"""The page in a real headless Chromium, over robots that exist for it only.

`JUNCNET_SCREENSHOTS=DIR` keeps pictures of it.
"""

import os
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from browser import Browser, needs_chromium, overflowing
from dashboards import FOLLOWER, Dashboard, Flown, dashboard
from juncnet import messages as m
from juncnet.clocks import NS_PER_S
from juncnet_services.dashboard.access import Right

pytestmark = needs_chromium
FIRST_HOLD_S = 0.3
SIZES = ((1280, 800), (820, 1180), (390, 844))


@pytest.fixture(name="browser", scope="module")
def _browser() -> Iterator[Browser]:
    with Browser() as browser:
        yield browser


@pytest.fixture(name="shown")
def _shown() -> Iterator[Dashboard]:
    with dashboard() as shown:
        yield shown


class Flying:
    """Robots that go on flying in a thread of their own; a context."""

    def __init__(self, *robots: Flown) -> None:
        self.robots = robots
        self.probability = 0.03
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._fly, daemon=True)

    def __enter__(self) -> "Flying":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join()

    def _fly(self) -> None:
        while not self._ended.wait(0.1):
            for robot in self.robots:
                robot.step(self.probability)


def opened(browser: Browser, shown: Dashboard, right: Right = Right.COMMAND) -> None:
    browser.resize(1280, 800)
    browser.open(shown.address.url(right))


def shoot(browser: Browser, name: str) -> None:
    folder = os.environ.get("JUNCNET_SCREENSHOTS")
    if folder:
        browser.picture(Path(folder) / f"{name}.png")


def test_a_flight_is_watched_from_its_first_event_to_its_summary(
    browser: Browser, shown: Dashboard
) -> None:
    robot = Flown(shown.bus)
    with Flying(robot) as flying:
        opened(browser, shown)
        browser.until_text("#verdict", "plain road 97 %")
        browser.until_text("#age", "ms old")
        browser.until_text("#road", "0.3 m left")
        browser.until("document.querySelectorAll('#rows tr').length == 6")
        flying.probability = 0.96
        robot.count, robot.phase = 1, m.Phase.APPROACHING
        robot.event(m.EventKind.APPROACHED)
        browser.until_text("#events", "Junction 1 ahead")
        browser.until_text("#verdict", "JUNCTION 96 %")
        browser.until_text("#phase", "Approaching junction 1")
        assert browser.text("#strip .here") == "↑\n1"
        flying.probability, robot.phase = 0.03, m.Phase.FOLLOWING
        for kind in (m.EventKind.ENTERED, m.EventKind.LEFT):
            robot.event(kind)
        browser.until("document.querySelector('#strip .done')")
        browser.until_text("#strip .next", "+60°\n2")
        shoot(browser, "fed")
        robot.count, robot.phase = 4, m.Phase.FINISHED
        robot.event(m.EventKind.MISSION_FINISHED)
        browser.until("document.getElementById('summary').open")
        summary = browser.text("#summary")
        assert "third_left" in summary
        assert "junctions counted" in summary
        browser.click("#summary button")
        time.sleep(0.5)
        assert not browser.run("document.getElementById('summary').open")
    assert browser.problems == []


def test_space_stops_within_a_third_of_a_second_wherever_the_cursor_is(
    browser: Browser, shown: Dashboard
) -> None:
    with Flying(Flown(shown.bus)):
        opened(browser, shown)
        browser.until("!document.getElementById('commands').hidden")

        def stops(how: Callable[[], None]) -> None:
            before, began_ns = len(shown.bus.orders), time.monotonic_ns()
            how()
            browser.until_text("#answer", "Stop: done")
            _, order, ns = shown.bus.orders[before]
            assert order.kind is m.OverrideKind.HOLD
            assert (ns - began_ns) / NS_PER_S < FIRST_HOLD_S
            browser.run("document.getElementById('answer').innerText = ''")

        stops(lambda: browser.press(" "))
        stops(lambda: browser.click("#stop"))
        browser.run("document.getElementById('land').focus()")
        stops(lambda: browser.press(" "))
        browser.press("s")
        browser.until("document.getElementById('swapper').open")
        browser.run("document.getElementById('model').focus()")
        stops(lambda: browser.press(" "))
        stops(lambda: browser.click("#stop"))
        kinds = {order.kind for _, order, _ in shown.bus.orders}
        assert kinds == {m.OverrideKind.HOLD}  # the focused button did not act
    assert browser.problems == []


def test_resume_and_land_ask_again(browser: Browser, shown: Dashboard) -> None:
    robot = Flown(shown.bus)
    robot.output = m.Output.STOPPED
    with Flying(robot):
        opened(browser, shown)
        browser.until("document.querySelector('#resume.offer')")
        browser.press("r")
        assert browser.text("#resume b") == "Sure?"
        assert shown.bus.orders == []
        browser.press("r")
        browser.until_text("#answer", "Resume: done")
        shown.bus.refusal = "not now"
        browser.click("#land")
        browser.click("#land")
        browser.until("document.querySelector('#answer.bad')")
        assert "NOT DONE: not now" in browser.text("#answer")
        kinds = [order.kind for _, order, _ in shown.bus.orders]
        assert kinds == [m.OverrideKind.RESUME, m.OverrideKind.LAND]


def test_model_and_follower_are_swapped_and_a_mission_is_edited(
    browser: Browser, shown: Dashboard
) -> None:
    robot = Flown(shown.bus)
    robot.phase, robot.output = m.Phase.WAITING, m.Output.HOLD
    with Flying(robot):
        opened(browser, shown)
        browser.until("!document.getElementById('commands').hidden")
        browser.press("s")
        browser.until("document.querySelectorAll('#models option').length")
        assert "now juncnet" in browser.text("#swapper")
        browser.run("document.getElementById('model').value = 'juncnet'")
        browser.click("#loadmodel")
        browser.until_text("#answer", "Model: done")
        browser.click("#loadfollower")
        browser.until_text("#answer", "Follower: done")
        robot.serve("better")
        browser.until_text("#swapper", "now better")
        browser.until_text("#events", "better instead of")
        browser.press("Escape")
        browser.press("m")
        browser.until("document.getElementById('editor').open")
        browser.click("#plan li:nth-child(1) button")
        browser.click("#more")
        shoot(browser, "editor")
        browser.until("!document.getElementById('send').disabled")
        browser.click("#send")
        browser.until("!document.getElementById('editor').open")
    model, follower, mission = [message for _, message in shown.bus.requests]
    assert isinstance(model, m.LoadModel)
    assert follower == m.LoadFollower(follower=FOLLOWER)
    assert isinstance(mission, m.SetMission)
    assert mission.mission.finish_after == 5
    assert [(t.at, t.turn or t.angle_deg) for t in mission.mission.turns] == [
        (1, "left"),
        (2, 60),
        (3, "left"),
    ]
    assert browser.problems == []


def test_who_may_only_watch_sees_no_button_that_works(browser: Browser, shown: Dashboard) -> None:
    with Flying(Flown(shown.bus)):
        opened(browser, shown, Right.WATCH)
        browser.until("!document.getElementById('rights').hidden")
        assert browser.run("document.getElementById('commands').offsetParent === null")
        for key in (" ", "r", "r", "l", "l", "m", "s"):
            browser.press(key)
        browser.until_text("#answer", "This page can only watch.")
        assert not browser.run("!!document.querySelector('dialog[open]')")
        browser.run("document.getElementById('stop').click()")
        time.sleep(0.5)
        assert shown.bus.orders == []


def test_several_robots_are_chosen_or_tiled_and_stopped_together(
    browser: Browser, shown: Dashboard
) -> None:
    robots = [Flown(shown.bus, name) for name in ("anna", "bert", "carl")]
    robots[1].phase, robots[1].count = m.Phase.TURNING, 2
    with Flying(*robots):
        opened(browser, shown)
        browser.until("document.querySelectorAll('#robots button').length == 4")
        browser.press("2")
        browser.until_text("#phase", "Turning at junction 2")
        browser.press(" ")
        browser.until_text("#answer", "Stop: done")
        assert [name for name, _, _ in shown.bus.orders] == ["bert"]
        browser.press("0")
        browser.until("document.querySelectorAll('.tile').length == 3")
        browser.until_text("#stopword", "STOP ALL 3")
        time.sleep(1.0)
        shoot(browser, "tiles")
        browser.press(" ")
        browser.until_text("#answer", "Stop 3 robots")
        assert sorted(name for name, _, _ in shown.bus.orders[1:]) == ["anna", "bert", "carl"]
        browser.click(".tile:nth-child(3) .halt")
        browser.until_text("#answer", "Stop: done")
        assert shown.bus.orders[-1][0] == "carl"
    assert browser.problems == []


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_stop_is_the_largest_thing_and_nothing_is_cut_off_at_any_size(
    browser: Browser, shown: Dashboard, scheme: str
) -> None:
    browser.prefer(scheme)
    with Flying(Flown(shown.bus)):
        opened(browser, shown)
        browser.until("document.getElementById('verdict').innerText")
        assert browser.run("document.documentElement.dataset.theme") == scheme
        for width, height in SIZES:
            browser.resize(width, height)
            browser.until(f"innerWidth == {width}")
            areas = browser.run(
                "[...document.querySelectorAll('button')].map(b => "
                "[b.getBoundingClientRect().width * b.getBoundingClientRect().height, b.id])"
                ".sort((a, b) => b[0] - a[0])"
            )
            assert areas[0][1] == "stop"
            assert areas[0][0] > 2.5 * areas[1][0]
            bottom = browser.run("document.getElementById('stop').getBoundingClientRect().bottom")
            assert bottom <= height
            assert overflowing(browser) == []
            small = browser.run(
                "[...document.querySelectorAll('footer button, header button')].filter(b => "
                "b.getBoundingClientRect().height < 44).length"
            )
            assert small == 0
            shoot(browser, f"fed-{scheme}-{width}")
    browser.prefer("light")


def test_an_old_picture_and_a_silent_dashboard_are_shown_as_such(browser: Browser) -> None:
    with dashboard() as shown:
        with Flying(Flown(shown.bus)):
            opened(browser, shown)
            browser.until_text("#age", "ms old")
        browser.until("document.querySelector('#picture.old')")
        browser.until_text("#status", "VEHICLE SILENT")
        browser.until("document.querySelector('tr.silent')")
    browser.until("!document.getElementById('alarm').hidden")
    assert "No answer" in browser.text("#alarm")
