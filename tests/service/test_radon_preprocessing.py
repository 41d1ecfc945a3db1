"""radon_preprocessing with a fake bus."""

from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from fakes import FakeBus
from juncnet.features import Extractor, Preprocessing
from juncnet.frames import Frame, FrameLayout
from juncnet.messages import ActiveModel, Features, ModelIdentity, PixelFormat, Stamp
from juncnet.topics import CAMERA_FRAME, MODEL_ACTIVE, RADON_FEATURES
from juncnet_services.radon_preprocessing.service import Config, run

SMALL = Preprocessing(size=16, angles=12)
GRAY = Preprocessing(size=16, channels=("gray",), standardisation="per_image")


@pytest.fixture(autouse=True)
def _own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))


def frame(sequence: int, width: int = 64, height: int = 48) -> Frame:
    layout = FrameLayout.packed(PixelFormat.I420, width, height)
    rng = np.random.default_rng(sequence)
    pixels = rng.integers(0, 256, layout.nbytes, dtype=np.uint8)
    header = Stamp(epoch=1, sequence=sequence, time_ns=sequence, clock="fake-clock")
    return Frame(header, layout, pixels)


def active(preprocessing: str, preprocessing_hash: str) -> ActiveModel:
    return ActiveModel(
        model=ModelIdentity(name="m", sha256="0" * 64),
        classes=("junction", "none"),
        preprocessing=preprocessing,
        preprocessing_hash=preprocessing_hash,
    )


def published(*script: tuple[object, object]) -> tuple[list[Features], FakeBus]:
    bus = FakeBus(list(script))
    run(bus, Config(preprocessing=SMALL))
    return bus.published[RADON_FEATURES.key], bus


def test_features_carry_the_frames_header_and_the_preprocessing() -> None:
    sent = [frame(1), frame(2, 100, 80)]
    features, bus = published(*((CAMERA_FRAME, f) for f in sent))
    assert [f.header for f in features] == [f.header for f in sent]
    assert {f.preprocessing for f in features} == {SMALL.hash}
    extractor = Extractor(SMALL)
    for message, picture in zip(features, sent, strict=True):
        np.testing.assert_array_equal(message.array, extractor(picture.luminance()))
    assert bus.health.outputs == 2
    assert bus.health.errors == []


def test_the_active_models_preprocessing_is_used_from_then_on() -> None:
    model = active(GRAY.model_dump_json(), GRAY.hash)
    features, bus = published(
        (CAMERA_FRAME, frame(1)), (MODEL_ACTIVE, model), (CAMERA_FRAME, frame(2))
    )
    assert [f.preprocessing for f in features] == [SMALL.hash, GRAY.hash]
    assert [f.shape for f in features] == [(2, 16, 16), (1, 16, 16)]
    assert bus.health.errors == []


@pytest.mark.parametrize(
    "model",
    [active("{}", GRAY.hash), active("not JSON", GRAY.hash), active('{"blur": 1}', GRAY.hash)],
    ids=["other hash", "not JSON", "unknown option"],
)
def test_a_preprocessing_that_cannot_be_had_is_an_error_and_the_old_one_stays(
    model: ActiveModel,
) -> None:
    features, bus = published((MODEL_ACTIVE, model), (CAMERA_FRAME, frame(1)))
    assert [f.preprocessing for f in features] == [SMALL.hash]
    assert len(bus.health.errors) == 1
    assert "refused" in bus.health.errors[0]


def test_a_frame_that_cannot_be_processed_is_skipped_and_told() -> None:
    header = Stamp(epoch=1, sequence=7, time_ns=7, clock="fake-clock")
    sliver = Frame(header, FrameLayout(PixelFormat.GRAY8, 9, 1, 9), np.zeros(9, np.uint8))
    features, bus = published((CAMERA_FRAME, sliver), (CAMERA_FRAME, frame(8)))
    assert [f.header.sequence for f in features] == [8]
    assert len(bus.health.errors) == 1
    assert "frame 7" in bus.health.errors[0]


def test_unknown_options_are_refused_by_name() -> None:
    with pytest.raises(ValidationError, match="filtre"):
        Config.model_validate({"preprocessing": {"filtre": "ramp"}})
