"""H.264 access units to pictures that can be trusted, each under the header of its access unit."""

from collections.abc import Iterator

from av.codec import CodecContext
from av.codec.context import Flags
from av.error import InvalidDataError
from av.packet import Packet
from av.video.codeccontext import VideoCodecContext
from av.video.frame import VideoFrame

from juncnet.messages import Stamp, VideoPacket

UNDECODED_KEPT = 64
"""Headers of pictures that the decoder still holds."""


class AccessUnitDecoder:
    """Decodes camera/video: no picture before a key frame, none after a loss until the next one.

    Whether something is missing before an access unit only the caller can tell: who decodes live
    hears every one, a recorder leaves some out on purpose.
    """

    def __init__(self) -> None:
        context = CodecContext.create("h264", "r")
        assert isinstance(context, VideoCodecContext)
        context.thread_count = 1
        context.options = {"err_detect": "explode"}
        context.flags |= Flags.low_delay
        self._context = context
        self._headers: dict[int, Stamp] = {}
        self._fed = 0
        self.waits_for_key_frame = True
        """Whether nothing can be decoded until one comes."""
        self.skipped = 0
        """Access units that could not be decoded for want of a key frame before them."""
        self.corrupt = 0
        """Access units that were damaged."""

    def feed(self, packet: VideoPacket, *, follows: bool) -> Iterator[tuple[VideoFrame, Stamp]]:
        """Yield (picture, header of its access unit) of what this access unit completes.

        `follows`: nothing is missing between it and the one fed before.
        """
        if not follows:
            self._distrust()
        if self.waits_for_key_frame and not packet.key_frame:
            self.skipped += 1
            return
        self.waits_for_key_frame = False
        self._fed += 1
        self._headers[self._fed] = packet.header
        unit = Packet(bytes(packet.payload))
        unit.pts = self._fed
        try:
            frames = self._context.decode(unit)  # pyright: ignore[reportUnknownMemberType]  # av: bare Packet
        except InvalidDataError:
            self.corrupt += 1
            self._distrust()
            return
        for frame in frames:
            header = self._headers.pop(frame.pts or 0, None)
            if frame.is_corrupt or header is None:
                self.corrupt += 1
                self._distrust()
                return
            yield frame, header
        if len(self._headers) > UNDECODED_KEPT:
            self._headers.clear()

    def _distrust(self) -> None:
        if not self.waits_for_key_frame:
            self._context.flush_buffers()
        self.waits_for_key_frame = True
        self._headers.clear()
