"""What viewers see of a recorded picture: made anew, while somebody asks for it."""

import logging

from juncnet.bus import Bus
from juncnet.features import Preprocessing
from juncnet.frames import Frame
from juncnet.messages import ActiveModel, Features
from juncnet.topics import CAMERA_IMAGE, RADON_FEATURES
from juncnet_services.frame_capture.jpeg import JpegOptions, encode_jpeg
from juncnet_services.radon_preprocessing.extractors import ExtractorSlot

log = logging.getLogger(__name__)


class ViewerPictures:
    """Publishes a frame as JPEG and, once a model was named, the features that it had of it."""

    def __init__(self, bus: Bus) -> None:
        self._bus = bus
        self._slot: ExtractorSlot | None = None

    def serve(self, active: ActiveModel) -> None:
        """Make the features that this model asks for from now on; none for another version's."""
        slot = ExtractorSlot(Preprocessing())
        try:
            slot.change(active.preprocessing, active.preprocessing_hash)
            self._slot = slot
        except ValueError as error:
            log.warning("no features are shown: preprocessing of %s: %s", active.model.name, error)
            self._slot = None

    def show(self, frame: Frame) -> None:
        """Publish what follows from `frame`, under its header."""
        if self._bus.wanted(CAMERA_IMAGE):
            self._bus.publish(CAMERA_IMAGE, encode_jpeg(frame, JpegOptions()))
        if self._slot is not None and self._bus.wanted(RADON_FEATURES):
            array = self._slot.extractor(frame.luminance())
            features = Features.from_array(array, frame.header, self._slot.hash)
            self._bus.publish(RADON_FEATURES, features)
