"""Smaller pictures: the same picture, of the format and under the header that it had."""

import numpy as np
import pytest
from numpy.typing import NDArray

from juncnet.frames import Frame, FrameLayout
from juncnet.messages import PixelFormat, Stamp
from juncnet.smaller import smaller

STAMP = Stamp(epoch=1, sequence=7, time_ns=9, clock="c")
FORMATS = list(PixelFormat)


def frame(kind: PixelFormat, width: int, height: int) -> Frame:
    """Return a picture brighter to the right, one half red."""
    columns = np.linspace(30, 200, width, dtype=np.uint8)
    grey: NDArray[np.uint8] = np.tile(columns, (height, 1))
    layout = FrameLayout.packed(kind, width, height)
    if kind is PixelFormat.GRAY8:
        return Frame(STAMP, layout, grey.reshape(-1))
    if kind is PixelFormat.BGR8:
        colours = np.stack([grey // 2, grey // 2, grey], axis=2)
        return Frame(STAMP, layout, colours.reshape(-1))
    u = np.full((height // 2, width // 2), 110, np.uint8)
    v = np.tile(np.linspace(128, 220, width // 2, dtype=np.uint8), (height // 2, 1))
    chroma = [u, v] if kind is PixelFormat.I420 else [np.stack([u, v], axis=2)]
    return Frame(STAMP, layout, np.concatenate([plane.reshape(-1) for plane in [grey, *chroma]]))


@pytest.mark.parametrize("kind", FORMATS)
@pytest.mark.parametrize(
    ("size", "max_width", "expected"),
    [
        ((128, 72), 64, (64, 36)),
        ((256, 144), 64, (64, 36)),
        ((128, 96), 96, (96, 72)),
        ((200, 120), 64, (64, 38)),
        ((132, 70), 65, None),
    ],
)
def test_it_is_the_same_picture_in_its_own_format(
    kind: PixelFormat, size: tuple[int, int], max_width: int, expected: tuple[int, int] | None
) -> None:
    big = frame(kind, *size)
    small = smaller(big, max_width)
    assert small.header == big.header
    assert small.layout.format is kind
    if expected is not None:
        assert (small.width, small.height) == expected
    assert small.width in (max_width, max_width - 1)
    assert abs(small.height / small.width - size[1] / size[0]) < 2 / small.width
    there = np.linspace(0, big.width - 1, small.width).astype(int)
    across, expected_across = small.bgr()[1], big.bgr()[1, there]
    assert np.abs(across.astype(int) - expected_across).mean() < 3


def test_a_half_is_the_mean_of_four_pixels() -> None:
    pixels = np.random.default_rng(3).integers(0, 256, (4, 8), np.uint8)
    big = Frame(STAMP, FrameLayout.packed(PixelFormat.GRAY8, 8, 4), pixels.reshape(-1))
    means = pixels.reshape(2, 2, 4, 2).mean(axis=(1, 3))
    assert np.abs(smaller(big, 4).plane() - means).max() <= 0.5


@pytest.mark.parametrize("kind", FORMATS)
def test_one_that_is_small_enough_stays_as_it_is(kind: PixelFormat) -> None:
    small = frame(kind, 64, 48)
    assert smaller(small, 64) is small


@pytest.mark.parametrize("kind", FORMATS)
def test_padding_is_no_part_of_the_picture(kind: PixelFormat) -> None:
    packed = frame(kind, 64, 48)
    rows = packed.layout.stride
    padded = FrameLayout(kind, 64, 48, rows + 16)
    pixels = np.full(padded.nbytes, 255, np.uint8)
    luminance = pixels[: padded.stride * 48].reshape(48, -1)
    luminance[:, :rows] = packed.pixels[: rows * 48].reshape(48, -1)
    if kind is PixelFormat.NV12:
        pixels[padded.stride * 48 :].reshape(24, -1)[:, :64] = packed.pixels[64 * 48 :].reshape(
            24, -1
        )
    elif kind is PixelFormat.I420:
        chroma = pixels[padded.stride * 48 :].reshape(48, -1)
        chroma[:, :32] = packed.pixels[64 * 48 :].reshape(48, -1)
    found = smaller(Frame(STAMP, padded, pixels), 32)
    np.testing.assert_array_equal(found.pixels, smaller(packed, 32).pixels)


def test_the_flattest_picture_keeps_two_rows() -> None:
    assert smaller(frame(PixelFormat.I420, 512, 2), 64).height == 2
