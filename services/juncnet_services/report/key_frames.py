"""The pictures at the junctions of a flight, each beside its Radon reconstruction."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from juncnet.features import Extractor, Preprocessing
from juncnet.frames import Frame
from juncnet.messages import ActiveModel, EventKind, Stamp
from juncnet.recording.reader import Recording
from juncnet.recording.video import VideoDecoder
from juncnet.topics import CAMERA_VIDEO
from juncnet_services.report.flight_data import Marked

Picture = NDArray[np.uint8]
WIDTH = 480
RADON = "radon"
LATE = 12
"""Pictures: half a second."""


@dataclass(frozen=True)
class KeyFrame:
    """The picture on which a junction was reported; (H, W, 3) each, blue first."""

    marked: Marked
    picture: Picture
    reconstruction: Picture


def key_frames(
    recording: Recording, events: Sequence[Marked], model: ActiveModel | None
) -> list[KeyFrame]:
    """Return the key frame of every junction that was approached, as far as video was recorded.

    Where that very picture is missing in the video, it is the next one, at most `LATE` later.
    """
    waiting = [m for m in events if m.event.kind is EventKind.APPROACHED]
    extractor, channel = _extractor(model)
    decoder, found = VideoDecoder(), list[KeyFrame]()
    for item in recording.messages([CAMERA_VIDEO.key]):
        for frame in decoder.decode(item.message):
            late = [(_late(frame.header, m), m) for m in waiting]
            due = [(by, m) for by, m in late if by is not None and by >= 0]
            for by, marked in due:
                waiting.remove(marked)
                if by <= LATE:
                    found.append(_key_frame(frame, marked, extractor, channel))
    return found


def _late(header: Stamp, marked: Marked) -> int | None:
    """Return by how many pictures `header` is later than the event's; None: not comparable."""
    wanted = marked.event.header
    return header.sequence - wanted.sequence if header.epoch == wanted.epoch else None


def _key_frame(frame: Frame, marked: Marked, extractor: Extractor, channel: int) -> KeyFrame:
    height = round(WIDTH * frame.height / frame.width)
    picture = cv2.resize(frame.bgr(), (WIDTH, height), interpolation=cv2.INTER_AREA)
    features = extractor(frame.luminance())[channel]
    return KeyFrame(marked, np.asarray(picture, np.uint8), _stretched(features, height))


def _extractor(model: ActiveModel | None) -> tuple[Extractor, int]:
    """Return what makes the features, and which channel of them is the reconstruction."""
    preprocessing = Preprocessing()
    if model is not None:
        own = Preprocessing.model_validate_json(model.preprocessing)
        preprocessing = own if RADON in own.channels else preprocessing
    return Extractor(preprocessing), preprocessing.channels.index(RADON)


def _stretched(channel: NDArray[np.float32], height: int) -> Picture:
    """Return a channel as a picture, its 1st to 99th percentile from black to white."""
    low, high = np.percentile(channel, (1, 99))
    span = max(float(high - low), 1e-6)
    gray: Picture = np.clip((channel - low) / span * 255, 0, 255).astype(np.uint8)
    large = np.asarray(cv2.resize(gray, (height, height), interpolation=cv2.INTER_CUBIC), np.uint8)
    return np.asarray(cv2.cvtColor(large, cv2.COLOR_GRAY2BGR), np.uint8)
