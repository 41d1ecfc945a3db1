"""One picture with all that was found in it, as bytes for the page: pure.

The bytes: length of the JSON (uint32, little-endian), the JSON, `jpeg_bytes` of JPEG, and the
features as uint8, channel by channel, if there are any.
"""

import json
import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from juncnet.camera import CameraGeometry
from juncnet.clocks import Instant, age_s
from juncnet.messages import Features, JpegImage, JunctionScore, RoadCommand
from juncnet_services.dashboard.overlay import road_lines
from juncnet_services.dashboard.robots import Key, Robot, key_of

DARKEST, BRIGHTEST = 1.0, 99.0
"""Percentiles of a channel that are shown black and white."""


def still(robot: Robot, after: Key, now: Instant, camera: CameraGeometry) -> bytes | None:
    """Return the robot's newest picture; None: there is none newer than the one called `after`."""
    image = robot.picture
    if image is None or key_of(image.header) == after:
        return None
    features: Features | None = robot.recent_features.upto(image.header)
    pixels = b"" if features is None else grey(features.array).tobytes()
    head = _head(robot, image, now, camera) | {
        "features": None if features is None else features.shape,
        "jpeg_bytes": len(image.payload),
    }
    text = json.dumps(head, separators=(",", ":")).encode()
    return b"".join([struct.pack("<I", len(text)), text, bytes(image.payload), pixels])


def _head(robot: Robot, image: JpegImage, now: Instant, camera: CameraGeometry) -> dict[str, Any]:
    header = image.header
    shape = camera.model_copy(update={"aspect": image.width / image.height})
    return {
        "epoch": str(header.epoch),
        "sequence": header.sequence,
        "age_s": age_s(header.instant, now),
        "width": image.width,
        "height": image.height,
        "score": _score(robot.recent_scores.upto(header), image),
        "road": _road(robot.roads.upto(header), image, shape),
    }


def _score(score: JunctionScore | None, image: JpegImage) -> dict[str, Any] | None:
    if score is None or score.header.epoch != image.header.epoch:
        return None
    return {
        "junction": round(score.junction, 4),
        "label": score.label,
        "behind": image.header.sequence - score.header.sequence,
    }


def _road(
    command: RoadCommand | None, image: JpegImage, camera: CameraGeometry
) -> dict[str, Any] | None:
    """Return the road and how many pictures older it is; None: the follower has not spoken."""
    if command is None or command.header.epoch != image.header.epoch:
        return None
    answer: dict[str, Any] = {
        "seen": command.velocity is not None,
        "confidence": round(command.confidence, 3),
        "behind": image.header.sequence - command.header.sequence,
    }
    if command.road is not None:
        answer |= {
            "offset_m": round(command.road.offset_m, 2),
            "width_m": round(command.road.width_m, 1),
            "lines": road_lines(command.road, camera),
        }
    return answer


def grey(features: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Return features (C, H, W) as pictures, uint8, each channel stretched to its own range."""
    low, high = np.percentile(features, [DARKEST, BRIGHTEST], axis=(1, 2), keepdims=True)
    scaled = 255 * (features - low) / np.maximum(high - low, 1e-6)
    return np.clip(scaled, 0, 255).astype(np.uint8)
