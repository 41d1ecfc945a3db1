"""From luminance to network input."""

import re
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from pydantic import ValidationError

from juncnet.features import Crop, Extractor, Preprocessing, cropped, sharpened
from juncnet.radon import filtered_back_projection, radon
from juncnet.shrink import shrink

SMALL = Preprocessing(size=16, angles=12)


def noise(*shape: int) -> NDArray[np.uint8]:
    return np.random.default_rng(7).integers(0, 256, shape, dtype=np.uint8)


def area_weights(length: int, size: int) -> NDArray[np.float64]:
    edges = np.arange(size + 1) * length / size
    pixels = np.arange(length)
    overlap = np.minimum(edges[1:, None], pixels + 1) - np.maximum(edges[:-1, None], pixels)
    return np.clip(overlap, 0, 1) * size / length


@pytest.mark.parametrize("shape", [(1080, 1920), (720, 1280), (481, 641), (128, 300), (100, 90)])
def test_resizing_is_the_exact_area_average(shape: tuple[int, int]) -> None:
    picture = noise(*shape)
    exact = area_weights(shape[0], 64) @ picture @ area_weights(shape[1], 64).T
    assert np.abs(shrink(picture, 64) - exact).max() < 1e-3


def test_resizing_reads_views_and_leaves_its_own_size_alone() -> None:
    padded = noise(300, 420)
    padded.flags.writeable = False
    view = padded[10:290, 5:405]
    np.testing.assert_array_equal(shrink(view, 64), shrink(view.copy(), 64))
    own = noise(64, 64)
    np.testing.assert_array_equal(shrink(own, 64), own)


def test_features_are_gray_and_its_reconstruction(tmp_path: Path) -> None:
    extractor = Extractor(SMALL, tmp_path)
    picture = noise(90, 160)
    features = extractor(picture)
    assert features.dtype == np.float32
    assert features.shape == (2, 16, 16)
    assert features[0].min() >= 0.0
    assert features[0].max() <= 1.0
    sinogram = extractor.sinogram(picture)
    np.testing.assert_array_equal(sinogram, radon(features[0], SMALL.angles_deg, False))
    back = filtered_back_projection(sinogram, SMALL.angles_deg, "ramp", False, 16)
    np.testing.assert_allclose(features[1], back, atol=1e-4)


def test_a_batch_equals_its_pictures_whatever_their_sizes(tmp_path: Path) -> None:
    extractor = Extractor(SMALL, tmp_path)
    pictures = [noise(90, 160), noise(16, 16), noise(33, 20), noise(8, 8)]
    singles = [extractor(picture) for picture in pictures]
    np.testing.assert_allclose(extractor.batch(pictures), singles, atol=1e-5)
    stack = noise(3, 20, 30)
    np.testing.assert_allclose(
        extractor.batch(stack), [extractor(picture) for picture in stack], atol=1e-5
    )


def test_channels_come_in_the_order_asked_for(tmp_path: Path) -> None:
    picture = noise(40, 40)
    both = Extractor(SMALL, tmp_path)(picture)
    swapped = SMALL.model_copy(update={"channels": ("radon", "gray")})
    np.testing.assert_array_equal(Extractor(swapped, tmp_path)(picture), both[::-1])
    gray = SMALL.model_copy(update={"channels": ("gray",)})
    np.testing.assert_array_equal(Extractor(gray, tmp_path)(picture), both[:1])


def test_standardised_channels_have_mean_0_and_deviation_1(tmp_path: Path) -> None:
    per_image = SMALL.model_copy(update={"standardisation": "per_image"})
    extractor = Extractor(per_image, tmp_path)
    features = extractor(noise(50, 50))
    assert features.dtype == np.float32
    np.testing.assert_allclose(features.mean(axis=(1, 2)), 0.0, atol=1e-5)
    np.testing.assert_allclose(features.std(axis=(1, 2)), 1.0, atol=1e-4)
    flat = extractor(np.full((50, 50), 90, np.uint8))
    np.testing.assert_allclose(flat[0], 0.0, atol=1e-3)


def test_sharpening_leaves_slopes_and_steepens_steps() -> None:
    ramp = np.tile(np.linspace(0.1, 0.9, 9, dtype=np.float32), (9, 1))[None]
    np.testing.assert_allclose(sharpened(ramp, 1.0)[0, :, 1:-1], ramp[0, :, 1:-1], atol=1e-6)
    step = np.full((1, 4, 4), 0.4, np.float32)
    step[:, :, 2:] = 0.6
    np.testing.assert_allclose(sharpened(step, 1.0)[0, 0], [0.4, 0.2, 0.8, 0.6], atol=1e-6)
    np.testing.assert_array_equal(sharpened(step, 0.0), step)


def test_crop_cuts_fractions() -> None:
    picture = noise(100, 200)
    left = cropped(picture, Crop(top=0.25, bottom=0.1, left=0.5, right=0.0))
    np.testing.assert_array_equal(left, picture[25:90, 100:])


@pytest.mark.parametrize(
    "bad", [np.zeros((4, 4)), np.zeros((4, 4, 3), np.uint8), np.zeros((1, 9), np.uint8)]
)
def test_what_is_no_picture_is_refused(tmp_path: Path, bad: NDArray[np.uint8]) -> None:
    with pytest.raises(ValueError, match=re.escape(str(bad.shape))):
        Extractor(SMALL, tmp_path)(bad)


def test_preprocessing_survives_json_with_its_hash() -> None:
    chosen = Preprocessing(
        crop=Crop(top=0.3), size=48, angles=(0.0, 30.5), filter=None, circle=True
    )
    again = Preprocessing.model_validate_json(chosen.model_dump_json())
    assert again == chosen
    assert again.hash == chosen.hash


def test_the_default_hash_is_stable() -> None:
    # Model files carry it: when this fails, every model must be exported again.
    expected = "ceb819612d5816457b117594ddd2041e9625660fbbfb5cd0add1ac93ce203e76"
    assert Preprocessing().hash == expected


@pytest.mark.parametrize(
    "change",
    [
        {"crop": {"top": 0.1}},
        {"size": 96},
        {"sharpening": 0.0},
        {"channels": ["gray"]},
        {"channels": ["radon", "gray"]},
        {"angles": 90},
        {"filter": "hann"},
        {"filter": None},
        {"circle": True},
        {"standardisation": "per_image"},
    ],
    ids=str,
)
def test_every_step_changes_the_hash(change: dict[str, object]) -> None:
    assert Preprocessing.model_validate(change).hash != Preprocessing().hash


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("sharpenning", 1.0),
        ("size", 4),
        ("angles", 0),
        ("channels", ["gray", "gray"]),
        ("channels", []),
        ("filter", "gauss"),
        ("crop", {"top": 0.6, "bottom": 0.5}),
        ("sharpening", float("nan")),
    ],
)
def test_bad_options_are_refused_by_name(field: str, value: object) -> None:
    with pytest.raises(ValidationError, match=field):
        Preprocessing.model_validate({field: value})
