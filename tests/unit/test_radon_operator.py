"""The reconstruction as one linear map: exact at every pixel, and its cache."""

from pathlib import Path

import numpy as np
import pytest

from juncnet import radon_build
from juncnet.radon import FilterName, evenly_spaced_angles, filtered_back_projection, radon
from juncnet.radon_build import build
from juncnet.radon_cache import load_reconstruction
from juncnet.radon_geometry import Geometry, Symmetry
from juncnet.radon_operator import F32, Reconstruction

GEOMETRIES = [
    Geometry(24, evenly_spaced_angles(20)),
    Geometry(24, evenly_spaced_angles(20), circle=True),
    Geometry(26, evenly_spaced_angles(12), "hamming"),
    Geometry(25, evenly_spaced_angles(12), "hann", circle=True),
    Geometry(24, evenly_spaced_angles(9), "cosine"),
    Geometry(17, evenly_spaced_angles(9), None, circle=True),
    Geometry(20, (3.0, 50.0, 77.5), "shepp-logan"),
    Geometry(20, (3.0, 50.0, 77.5), circle=True),
    Geometry(21, (0.0, 45.0, 90.0, 135.0, 180.0), "ramp"),
]


def two_stages(geometry: Geometry, picture: np.ndarray) -> np.ndarray:
    sinogram = radon(picture.astype(np.float64), geometry.angles_deg, geometry.circle)
    return filtered_back_projection(
        sinogram,
        geometry.angles_deg,
        geometry.filter_name,
        geometry.circle,
        output_size=geometry.size,
    )


@pytest.mark.parametrize("geometry", GEOMETRIES, ids=str)
def test_every_impulse_is_reconstructed_as_in_two_stages(geometry: Geometry) -> None:
    # All impulses: the error of any picture in [0, 1] is at most the sum of these.
    size = geometry.size
    impulses = np.eye(size * size, dtype=np.float32).reshape(-1, size, size)
    ours = Reconstruction(geometry, build(geometry))(impulses)
    expected = np.stack([two_stages(geometry, impulse) for impulse in impulses])
    assert np.abs(ours - expected).sum(axis=0).max() < 1e-4


def test_what_the_first_offset_adds_is_kept_as_a_product_that_is_as_exact(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    geometry = Geometry(48, evenly_spaced_angles(60), circle=True)
    impulses = np.eye(48 * 48, dtype=np.float32).reshape(-1, 48, 48)
    matrix = build(geometry)

    def as_it_is(matrix: F32) -> tuple[F32]:
        return (matrix,)

    monkeypatch.setattr(radon_build, "_factors", as_it_is)
    whole = build(geometry)
    assert max(len(correction.factors) for correction in matrix.rim) == 2
    assert matrix.nbytes < whole.nbytes
    difference = Reconstruction(geometry, matrix)(impulses) - Reconstruction(geometry, whole)(
        impulses
    )
    assert np.abs(difference).sum(axis=0).max() < 1e-5


@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_few_pictures_are_reconstructed_as_many_are(count: int) -> None:
    # 112: the block that serves two parts is larger than what stays near the processor.
    geometry = Geometry(112, evenly_spaced_angles(4))
    reconstruct = Reconstruction(geometry, build(geometry))
    pictures = np.random.default_rng(0).random((9, 112, 112), dtype=np.float32)
    np.testing.assert_allclose(
        reconstruct(pictures[:count]), reconstruct(pictures)[:count], atol=1e-4
    )


def test_the_papers_geometry_uses_the_whole_symmetry_of_the_square() -> None:
    geometry = Geometry(64, evenly_spaced_angles(180))
    assert geometry.symmetry is Symmetry.SQUARE
    assert Geometry(64, evenly_spaced_angles(45)).symmetry is Symmetry.MIRRORS
    assert Geometry(64, (1.0, 2.0)).symmetry is Symmetry.NONE


def test_a_batch_equals_its_pictures(tmp_path: Path) -> None:
    reconstruct = load_reconstruction(Geometry(24, evenly_spaced_angles(20)), tmp_path)
    pictures = np.random.default_rng(0).random((5, 24, 24), dtype=np.float32)
    singles = [reconstruct(picture[None])[0] for picture in pictures]
    np.testing.assert_allclose(reconstruct(pictures), singles, atol=1e-5)
    assert reconstruct(pictures[:0]).shape == (0, 24, 24)


def test_pictures_of_another_size_are_refused(tmp_path: Path) -> None:
    reconstruct = load_reconstruction(Geometry(24, (0.0, 90.0)), tmp_path)
    with pytest.raises(ValueError, match=r"\(N, 24, 24\)"):
        reconstruct(np.zeros((1, 25, 24), np.float32))


def test_bad_parameters_are_refused_by_name() -> None:
    wrong: FilterName = "gauss"  # pyright: ignore[reportAssignmentType]
    with pytest.raises(ValueError, match="gauss"):
        Geometry(24, (0.0,), wrong)
    with pytest.raises(ValueError, match="size"):
        Geometry(1, (0.0,))
    with pytest.raises(ValueError, match="angles_deg"):
        Geometry(24, ())


def test_the_cache_is_used_and_keyed_by_all_parameters(tmp_path: Path) -> None:
    geometry = Geometry(12, evenly_spaced_angles(6))
    load_reconstruction(geometry, tmp_path)
    (file,) = tmp_path.iterdir()
    before = file.stat().st_mtime_ns
    load_reconstruction(geometry, tmp_path)
    assert file.stat().st_mtime_ns == before
    for other in (
        Geometry(13, geometry.angles_deg),
        Geometry(12, evenly_spaced_angles(8)),
        Geometry(12, geometry.angles_deg, "hann"),
        Geometry(12, geometry.angles_deg, circle=True),
    ):
        load_reconstruction(other, tmp_path)
    assert len(list(tmp_path.iterdir())) == 5


@pytest.mark.parametrize("damage", ["empty", "cut", "noise", "other"])
def test_a_damaged_cache_is_rebuilt(tmp_path: Path, damage: str) -> None:
    geometry = Geometry(12, evenly_spaced_angles(6))
    picture = np.random.default_rng(0).random((1, 12, 12), dtype=np.float32)
    expected = load_reconstruction(geometry, tmp_path)(picture)
    (file,) = tmp_path.iterdir()
    whole = file.read_bytes()
    middle = len(whole) // 2
    match damage:
        case "empty":
            file.write_bytes(b"")
        case "cut":
            file.write_bytes(whole[:middle])
        case "noise":
            file.write_bytes(whole[:middle] + bytes(64) + whole[middle + 64 :])
        case _:
            np.savez(file, ee=np.zeros((3, 3), np.float32))
    np.testing.assert_array_equal(load_reconstruction(geometry, tmp_path)(picture), expected)
    np.testing.assert_array_equal(load_reconstruction(geometry, tmp_path)(picture), expected)
    assert file.stat().st_size == len(whole)


def test_a_cache_that_cannot_be_written_does_no_harm(tmp_path: Path) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("not a directory")
    reconstruct = load_reconstruction(Geometry(12, evenly_spaced_angles(6)), blocked)
    assert reconstruct(np.ones((1, 12, 12), np.float32)).shape == (1, 12, 12)
