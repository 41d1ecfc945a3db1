"""The camera renderer against the geometry of its camera."""

import math

import cv2
import numpy as np
import pytest

from juncnet.camera import CameraGeometry
from juncnet.simulation.ground import GroundTexture
from juncnet.simulation.palettes import PALETTES, jitter
from juncnet.simulation.render import Renderer
from juncnet.simulation.view import view_from
from juncnet.simulation.world import Box, Node, Patch, Road, Start, Style, Tree, World

CAMERA = CameraGeometry()
SIZE = (640, 360)


def straight(first: int, a: Node, b: Node, width_m: float = 6.0) -> Road:
    t = np.linspace(0, 1, 120)[:, None]
    centre = np.array([a.x_m, a.y_m]) * (1 - t) + np.array([b.x_m, b.y_m]) * t
    return Road(first, a.id, b.id, centre, width_m)


@pytest.fixture(scope="module")
def world() -> World:
    """A T: a road along x from 0 to 40, and one across its end."""
    nodes = [Node(0, 0, 0), Node(1, 40, 0), Node(2, 40, 30), Node(3, 40, -30)]
    roads = [straight(i, nodes[a], nodes[b]) for i, (a, b) in enumerate([(0, 1), (1, 2), (1, 3)])]
    return World(
        "t",
        7,
        {n.id: n for n in nodes},
        {r.id: r for r in roads},
        Start(0, 0, 0, 0, 1),
        boxes=(
            Box("building", 20, 15, 0.3, 9, 7, 6, (200, 200, 200), 3),
            Box("car", 15, 4, 0, 4.3, 1.8, 1.5, (30, 30, 200), 4),
        ),
        trees=(Tree(25, -9, 2, 6, 1), Tree(8, 6, 1, 1.5, 2)),
        patches=(Patch("mud", 10, -6, 1, 1), Patch("puddle", 12, -5, 1, 2)),
        style=Style(haze=0.0),
    )


@pytest.fixture(scope="module")
def ground(world: World) -> GroundTexture:
    return GroundTexture(world, 0.1)


@pytest.fixture(scope="module")
def renderer(world: World, ground: GroundTexture) -> Renderer:
    return Renderer(world, *SIZE, CAMERA, ground=ground)


def luma(picture: np.ndarray, size: tuple[int, int] = SIZE) -> np.ndarray:
    return picture[: size[0] * size[1]].reshape(size[1], size[0])


@pytest.fixture(scope="module")
def dark(world: World) -> GroundTexture:
    """A ground without anything on it."""
    texture = GroundTexture(world, 0.05)
    texture.beyond = (40, 128, 128)
    for plane in texture.luma:
        plane[:] = 40
    return texture


@pytest.mark.parametrize("dot", [(6.0, 0.0), (9.0, -3.0), (12.0, 2.5), (7.0, 4.0)])
@pytest.mark.parametrize("heading", [0.0, 0.7, -2.0])
def test_a_painted_dot_appears_where_the_camera_projects_it(
    world: World, dark: GroundTexture, dot: tuple[float, float], heading: float
) -> None:
    bare = World(world.name, world.seed, world.nodes, world.roads, world.start, style=world.style)
    x, y = 20.0, 5.0
    s, c = math.sin(heading), math.cos(heading)
    east, north = x + c * dot[0] - s * dot[1], y + s * dot[0] + c * dot[1]
    dark.luma[0][:] = 40
    column, row, _ = dark.map_to_plane(dark.metres_per_px) @ [east, north, 1]
    place = (round(column * 16), round(row * 16))
    cv2.circle(dark.luma[0], place, 24, 255, -1, cv2.LINE_AA, 4)
    picture = Renderer(bare, *SIZE, CAMERA, noise=0, ground=dark).render_i420(x, y, heading)
    seen = luma(picture).astype(float)
    seen[: int(CAMERA.horizon_row * SIZE[1]) + 3] = 0
    weight = np.clip(seen - 90, 0, None)
    assert weight.sum() > 0
    found_row = (weight.sum(axis=1) @ (np.arange(SIZE[1]) + 0.5)) / weight.sum()
    found_column = (weight.sum(axis=0) @ (np.arange(SIZE[0]) + 0.5)) / weight.sum()
    projected = CAMERA.project(*dot)
    assert projected is not None
    assert found_column == pytest.approx(projected[0] * SIZE[0], abs=1.0)
    assert found_row == pytest.approx(projected[1] * SIZE[1], abs=1.0)


def test_the_view_agrees_with_the_camera_geometry() -> None:
    view = view_from(CAMERA, (1920, 1080), (0, 0, 0))
    for x, y in ((5.0, 1.0), (20.0, -6.0), (100.0, 30.0)):
        pixel = view.ground @ [x, y, 1]
        expected = CAMERA.project(x, y)
        assert expected is not None
        assert pixel[0] / pixel[2] + 0.5 == pytest.approx(expected[0] * 1920, abs=1e-6)
        assert pixel[1] / pixel[2] + 0.5 == pytest.approx(expected[1] * 1080, abs=1e-6)
    assert view.horizon[1] + 0.5 == pytest.approx(CAMERA.horizon_row * 1080, abs=1e-6)


def test_the_sky_ends_at_the_horizon(renderer: Renderer) -> None:
    mask = renderer.road_mask(-40, 0, 0, *SIZE)
    horizon = CAMERA.horizon_row * SIZE[1]
    assert not mask[: int(horizon)].any()
    # Off the roads, looking away from everything: light sky above, darker ground below.
    seen = luma(renderer.render_i420(-20, 0, math.pi)).astype(float).mean(axis=1)
    drop = int(np.argmin(np.diff(seen)))
    assert drop == pytest.approx(horizon, abs=8)


def test_roll_turns_the_horizon() -> None:
    for roll in (0.1, -0.1):
        view = view_from(CAMERA, SIZE, (0, 0, 0), roll_rad=roll)
        left, right = view.horizon_rows()
        # Right side down: the ground rises on the right, so the horizon's right end is higher.
        assert (left - right) * roll > 0
        slope = (left - right) / (SIZE[0] - 1)
        assert math.atan(slope) == pytest.approx(
            math.atan(math.tan(roll) / math.cos(CAMERA.pitch_rad)), abs=1e-6
        )


def test_nose_down_and_height_move_the_picture() -> None:
    level = view_from(CAMERA, SIZE, (0, 0, 0))
    down = view_from(CAMERA, SIZE, (0, 0, 0), pitch_rad=0.05)
    assert down.horizon[1] < level.horizon[1]
    high = view_from(CAMERA, SIZE, (0, 0, 0), z_offset_m=1.0)
    assert high.position[2] == pytest.approx(CAMERA.height_m + 1.0)


def test_the_road_mask_agrees_with_the_centre_line(renderer: Renderer) -> None:
    mask = renderer.road_mask(5, 0, 0, *SIZE)
    assert mask.shape == (SIZE[1], SIZE[0])
    assert set(np.unique(mask)) == {0, 255}
    for ahead in (5.0, 8.0, 12.0, 20.0):
        for aside, expected in ((0.0, 255), (2.7, 255), (-2.7, 255), (3.4, 0), (-3.4, 0)):
            point = CAMERA.project(ahead, aside)
            assert point is not None
            column, row = int(point[0] * SIZE[0]), int(point[1] * SIZE[1])
            if 0 <= column < SIZE[0] and 0 <= row < SIZE[1]:
                assert mask[row, column] == expected, (ahead, aside)


def test_the_mask_tells_junctions_apart(renderer: Renderer) -> None:
    mask = renderer.road_mask(25, 0, 0, *SIZE, classes=True)
    for ahead, expected in ((6.0, 1), (15.0, 2)):
        point = CAMERA.project(ahead, 0)
        assert point is not None
        assert mask[int(point[1] * SIZE[1]), int(point[0] * SIZE[0])] == expected


def test_same_arguments_give_the_same_picture(world: World, renderer: Renderer) -> None:
    pose = (3.0, 0.2, 0.1, 0.05, 0.02, -0.01)
    first = renderer.render_i420(*pose)
    renderer.render_i420(9, 1, 2)
    again = Renderer(world, *SIZE, CAMERA, ground=GroundTexture(world, 0.1))
    assert np.array_equal(first, renderer.render_i420(*pose))
    assert np.array_equal(first, again.render_i420(*pose))
    assert not np.array_equal(first, renderer.render_i420(3.5, *pose[1:]))


def test_it_writes_into_the_memory_given(renderer: Renderer) -> None:
    out = np.zeros(SIZE[0] * SIZE[1] * 3 // 2, np.uint8)
    assert renderer.render_i420(3, 0, 0, out=out) is out
    assert np.array_equal(out, renderer.render_i420(3, 0, 0))
    with pytest.raises(ValueError, match="out must be flat uint8"):
        renderer.render_i420(3, 0, 0, out=out[1:])


@pytest.mark.parametrize("size", [(160, 160), (98, 202), (258, 34)])
def test_pictures_of_any_even_size(
    world: World, ground: GroundTexture, size: tuple[int, int]
) -> None:
    small = Renderer(world, *size, CAMERA, ground=ground)
    for yaw in (0.0, 2.0, 4.0):
        assert small.render_i420(10, 1, yaw, 0.1, 0.2, 0.1).shape == (size[0] * size[1] * 3 // 2,)
    with pytest.raises(ValueError, match="must be even"):
        Renderer(world, size[0] + 1, size[1], CAMERA, ground=ground)


def test_objects_stand_in_the_picture(world: World, ground: GroundTexture) -> None:
    bare = World(world.name, world.seed, world.nodes, world.roads, world.start, style=world.style)
    full = Renderer(world, *SIZE, CAMERA, noise=0, ground=ground).render_i420(5, 0, 0.2)
    empty = Renderer(bare, *SIZE, CAMERA, noise=0, ground=ground).render_i420(5, 0, 0.2)
    view = view_from(CAMERA, SIZE, (5, 0, 0.2))
    for x, y, z in ((20, 15, 2), (15, 4, 0.8)):
        column, row, depth = view.projection @ [x, y, z, 1]
        at = (int(row / depth), int(column / depth))
        assert abs(int(luma(full)[at]) - int(luma(empty)[at])) > 8


def test_palettes_vary_by_seed_alone() -> None:
    palette = PALETTES["temperate"]
    assert jitter(palette, np.random.default_rng(1), 0.0).grass == pytest.approx(palette.grass)
    one, same = (jitter(palette, np.random.default_rng(2), 0.5) for _ in range(2))
    assert one == same
    assert one != jitter(palette, np.random.default_rng(3), 0.5)


def test_an_unknown_palette_is_named(world: World) -> None:
    odd = World("x", 1, world.nodes, world.roads, world.start, style=Style(palette="mauve"))
    with pytest.raises(ValueError, match="mauve"):
        GroundTexture(odd, 0.5)
