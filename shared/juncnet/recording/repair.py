"""Completes recordings whose recorder was killed, so that every viewer opens them."""

import fcntl
from collections import defaultdict
from collections.abc import Generator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from mcap import records
from mcap.writer import Writer

from juncnet.recording import SUFFIX
from juncnet.recording.reader import RecordingError, file_records
from juncnet.recording.writer import CHUNK_BYTES

REPAIRING = ".repairing"


def is_complete(path: Path) -> bool:
    """Return whether the file ends as a complete MCAP file does."""
    with path.open("rb") as stream:
        stream.seek(0, 2)
        if stream.tell() < 16:
            return False
        stream.seek(-8, 2)
        return stream.read() == b"\x89MCAP0\r\n"


def repair(path: Path) -> int:
    """Rewrite a truncated recording as a complete one in its place; return its messages.

    Raises:
        RecordingError: not even its beginning can be read.
    """
    draft = path.with_suffix(REPAIRING)
    count = 0
    with draft.open("wb") as stream:
        writer = Writer(stream, chunk_size=CHUNK_BYTES)
        writer.start("juncnet")
        schemas: dict[int, int] = {0: 0}
        channels: dict[int, int] = defaultdict(int)
        for record in file_records(path):
            if isinstance(record, records.Schema) and record.id not in schemas:
                schemas[record.id] = writer.register_schema(
                    record.name, record.encoding, record.data
                )
            elif isinstance(record, records.Channel) and record.id not in channels:
                channels[record.id] = writer.register_channel(
                    record.topic,
                    record.message_encoding,
                    schemas[record.schema_id],
                    record.metadata,
                )
            elif isinstance(record, records.Message):
                count += 1
                writer.add_message(
                    channels[record.channel_id],
                    record.log_time,
                    record.data,
                    record.publish_time,
                    record.sequence,
                )
            elif isinstance(record, records.Metadata):
                writer.add_metadata(record.name, dict(record.metadata))
            elif isinstance(record, records.Attachment):
                writer.add_attachment(
                    record.create_time,
                    record.log_time,
                    record.name,
                    record.media_type,
                    record.data,
                )
        writer.finish()
    draft.replace(path)
    return count


@contextmanager
def claimed(path: Path) -> Generator[bool]:
    """Give whether the file is free: no recorder writes it, nobody repairs it; held meanwhile.

    False also where it cannot be locked: it is another user's, or the file system has no locks.
    """
    with ExitStack() as stack:
        try:
            stream = stack.enter_context(path.open("r+b"))
            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
            free = True
        except OSError:
            free = False
        yield free


def repair_all(folder: Path) -> list[Path]:
    """Repair what killed recorders left in `folder`; return the files that were repaired."""
    repaired: list[Path] = []
    for path in sorted(folder.glob(f"*{SUFFIX}")):
        with claimed(path) as free:
            if not free or is_complete(path):
                continue
            try:
                repair(path)
            except RecordingError:
                continue
            repaired.append(path)
    return repaired
