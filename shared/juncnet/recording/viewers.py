"""What viewers (Foxglove, Rerun) know how to draw, made from our messages. Pure.

Schemas are Foxglove's, from its own package of generated classes.
"""

import math

from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.CompressedVideo_pb2 import CompressedVideo
from foxglove_schemas_protobuf.LocationFix_pb2 import LocationFix
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from google.protobuf.message import Message as Protobuf
from google.protobuf.timestamp_pb2 import Timestamp

from juncnet.messages import (
    GeoPoint,
    Health,
    JpegImage,
    JunctionEvent,
    Message,
    Pose,
    VehicleState,
    VideoPacket,
)

NS_PER_S = 1_000_000_000
WORLD, CAMERA = "world", "camera"
"""Frames of reference, as viewers name them."""


def timestamp(time_ns: int) -> Timestamp:
    """Return nanoseconds since 1970 as protobuf has them."""
    return Timestamp(seconds=time_ns // NS_PER_S, nanos=time_ns % NS_PER_S)


def payload_of(message: Message, time_ns: int) -> Protobuf | None:
    """Return the picture in a bulk message, captured at `time_ns`; None if it is no picture."""
    at = timestamp(time_ns)
    if isinstance(message, VideoPacket):
        data = bytes(message.payload)
        return CompressedVideo(timestamp=at, frame_id=CAMERA, data=data, format="h264")
    if isinstance(message, JpegImage):
        data = bytes(message.payload)
        return CompressedImage(timestamp=at, frame_id=CAMERA, data=data, format="jpeg")
    return None


def drawn(message: Message, time_ns: int) -> list[tuple[str, Protobuf]]:
    """Return what viewers draw of a message: name below its key, and content."""
    if isinstance(message, VehicleState):
        found: list[tuple[str, Protobuf]] = []
        if message.pose is not None:
            found.append(("pose", _pose(message.pose, time_ns)))
        if message.gps is not None:
            found.append(("fix", _fix(message.gps, time_ns)))
        return found
    if isinstance(message, JunctionEvent):
        text = f"{message.kind} junction {message.count} ({message.label})"
        return [("log", _log(Log.INFO, "junction_navigation", text, time_ns))]
    if isinstance(message, Health) and message.last_error:
        return [("log", _log(Log.WARNING, message.service, message.last_error, time_ns))]
    return []


def _pose(pose: Pose, time_ns: int) -> PoseInFrame:
    drawn = PoseInFrame(timestamp=timestamp(time_ns), frame_id=WORLD)
    drawn.pose.position.x, drawn.pose.position.y = pose.x_m, pose.y_m
    drawn.pose.position.z = pose.z_m
    cr, sr = math.cos(pose.roll_rad / 2), math.sin(pose.roll_rad / 2)
    cp, sp = math.cos(pose.pitch_rad / 2), math.sin(pose.pitch_rad / 2)
    cy, sy = math.cos(pose.yaw_rad / 2), math.sin(pose.yaw_rad / 2)
    turned = drawn.pose.orientation
    turned.w = cr * cp * cy + sr * sp * sy
    turned.x = sr * cp * cy - cr * sp * sy
    turned.y = cr * sp * cy + sr * cp * sy
    turned.z = cr * cp * sy - sr * sp * cy
    return drawn


def _fix(point: GeoPoint, time_ns: int) -> LocationFix:
    return LocationFix(
        timestamp=timestamp(time_ns),
        frame_id=WORLD,
        latitude=point.latitude_deg,
        longitude=point.longitude_deg,
        altitude=point.altitude_m,
    )


def _log(level: Log.Level.ValueType, name: str, text: str, time_ns: int) -> Log:
    return Log(timestamp=timestamp(time_ns), level=level, message=text, name=name)
