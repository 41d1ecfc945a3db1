"""Recordings of flights as footage: the camera's H.264, and when each picture was taken."""

from collections.abc import Sequence
from pathlib import Path

from juncnet.learning.footage.intervals import FootageError
from juncnet.recording import MISSING


def write_stream(recording: Path, out: Path) -> Sequence[float]:
    """Write the bare H.264 of a recording to `out`; return the pictures' times [s] from the first.

    A recording of several files is named by its first one.

    Raises:
        FootageError: the extra [record] is missing, or it is no recording with video in it.
    """
    try:
        from juncnet.recording.reader import RecordingError, open_recording
    except ImportError as error:
        raise FootageError(f"{recording}: {MISSING}") from error
    from juncnet.messages import VideoPacket
    from juncnet.topics import CAMERA_VIDEO

    times_ns: list[int] = []
    try:
        with out.open("wb") as stream:
            for recorded in open_recording(recording).messages([CAMERA_VIDEO.key]):
                packet: VideoPacket = recorded.message
                # Before the first key frame there is nothing to decode.
                if packet.key_frame or times_ns:
                    stream.write(bytes(packet.payload))
                    times_ns.append(packet.header.time_ns)
    except RecordingError as error:
        raise FootageError(str(error)) from error
    if not times_ns:
        raise FootageError(
            f"{recording} has no video in it: record {CAMERA_VIDEO.key} (`juncnet record --help`)"
        )
    return [(time_ns - times_ns[0]) / 1e9 for time_ns in times_ns]


def is_first_part(path: Path) -> bool:
    """Return whether a file is a recording's first or only one: NAME-001.mcap follows another."""
    number = path.stem.rpartition("-")[2]
    return not (len(number) == 3 and number.isdigit() and int(number) > 0)
