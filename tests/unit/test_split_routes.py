"""What crosses the link to the vehicle follows from the two lists of processes."""

from itertools import product

import pytest

from juncnet.routes import Routes
from juncnet.topics import CAMERA_VIDEO, SERVICES


@pytest.mark.parametrize("moved", range(2 ** (len(SERVICES) - 1)))
def test_wherever_a_service_runs_each_other_one_hears_it_once(moved: int) -> None:
    laptop = tuple(name for bit, name in enumerate(SERVICES[:-1]) if moved >> bit & 1)
    for listener, publisher in product(laptop, SERVICES):
        if listener == publisher:
            continue
        routes = Routes(laptop, listener)
        here = routes.hears_here(publisher) and publisher in laptop
        there = routes.hears_there(publisher, f"juncnet/robot/{publisher}")
        assert here != there, (listener, publisher)


def test_a_service_on_both_sides_takes_from_the_other_and_sends_nothing_back() -> None:
    routes, key = Routes(("frame_capture",), "frame_capture"), CAMERA_VIDEO.expression("robot")
    assert routes.tells_there(key)
    assert routes.hears_there("frame_capture", key)
    assert not routes.hears_here("frame_capture")
    assert not routes.tells_there(key)
    assert routes.tells_there("juncnet/robot/camera/image")


def test_listeners_to_everybody_hear_both_sides() -> None:
    routes = Routes(("frame_capture",), "recorder")
    assert routes.hears_here("*")
    assert routes.hears_there("*", "juncnet/robot/health/*")
