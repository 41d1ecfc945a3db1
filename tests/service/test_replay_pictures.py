"""Viewers of a replay get JPEG and features of every recorded picture, if they ask for them."""

import numpy as np
import pytest

from fakes import FakeBus
from juncnet.features import Extractor, Preprocessing
from juncnet.frames import Frame, FrameLayout
from juncnet.messages import ActiveModel, ModelIdentity, PixelFormat
from juncnet.topics import CAMERA_IMAGE, RADON_FEATURES
from juncnet_services.cli.replay_pictures import ViewerPictures
from scenes import stamp

PICTURE = np.arange(160 * 90, dtype=np.uint32).reshape(90, 160).astype(np.uint8)


def frame() -> Frame:
    layout = FrameLayout.packed(PixelFormat.GRAY8, 160, 90)
    return Frame(stamp(1.0), layout, PICTURE.reshape(-1))


def active(preprocessing: Preprocessing) -> ActiveModel:
    return ActiveModel(
        model=ModelIdentity(name="other", sha256="0" * 64),
        classes=("none", "junction"),
        preprocessing=preprocessing.model_dump_json(),
        preprocessing_hash=preprocessing.hash,
    )


def test_pictures_and_features_come_under_the_header_of_their_frame() -> None:
    bus = FakeBus()
    pictures, other = ViewerPictures(bus), Preprocessing(standardisation="per_image")
    pictures.serve(active(other))
    pictures.show(frame())
    (image,), (features,) = bus.published[CAMERA_IMAGE.key], bus.published[RADON_FEATURES.key]
    assert image.header == features.header == stamp(1.0)
    assert (image.width, image.height) == (160, 90)
    np.testing.assert_array_equal(features.array, Extractor(other)(PICTURE))


def test_nothing_is_made_that_nobody_asks_for() -> None:
    bus = FakeBus(subscribers=False)
    ViewerPictures(bus).show(frame())
    assert bus.published == {}


def test_without_a_model_that_this_version_knows_there_are_pictures_only(
    caplog: pytest.LogCaptureFixture,
) -> None:
    bus = FakeBus()
    pictures = ViewerPictures(bus)
    named = active(Preprocessing()).model_copy(update={"preprocessing_hash": "1" * 64})
    pictures.serve(named)
    pictures.show(frame())
    assert list(bus.published) == [CAMERA_IMAGE.key]
    assert "no features are shown" in caplog.text
