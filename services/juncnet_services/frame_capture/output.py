"""Pictures of a camera onto the bus: frame first, then what else is wanted; and their health."""

from functools import partial

import numpy as np

from juncnet.bus import Bus
from juncnet.frames import Frame
from juncnet.messages import Stamp, VideoPacket
from juncnet.topics import CAMERA_FRAME, CAMERA_IMAGE, CAMERA_VIDEO
from juncnet_services.frame_capture.contract import AccessUnit, Camera, Picture
from juncnet_services.frame_capture.frozen import FrozenGate, fingerprint
from juncnet_services.frame_capture.jpeg import JpegEncoder, JpegOptions


class CameraOutput:
    """Publishes one camera: camera/frame, camera/image, camera/video and health counters."""

    def __init__(self, bus: Bus, camera: Camera, jpeg: JpegOptions, frozen_limit: int) -> None:
        self._bus = bus
        self._camera = camera
        self._writer = bus.frames_out(CAMERA_FRAME)
        self._gate = FrozenGate(frozen_limit)
        self._jpeg_options = jpeg
        self._encoder: JpegEncoder | None = None
        self._frames = 0
        self._units = 0

    def show(self, picture: Picture) -> None:
        """Publish the picture as camera/frame unless the camera is frozen, then as camera/image."""
        taken_ns = self._bus.clock.now_ns()
        loan = self._writer.loan(picture.layout)
        picture.write(loan.pixels)
        header = picture.header or self._stamp(self._frames, picture.captured_ns)
        if self._camera.live and not self._moves(Frame(header, picture.layout, loan.pixels)):
            return
        self._frames += 1
        loan.send(header)
        self._bus.health.output(taken_ns, header)
        if self._bus.wanted(CAMERA_IMAGE) and self._jpeg.wants(taken_ns):
            pixels = np.empty(picture.layout.nbytes, np.uint8)
            picture.write(pixels)
            self._jpeg.offer(Frame(header, picture.layout, pixels), taken_ns)

    @property
    def _jpeg(self) -> JpegEncoder:
        if self._encoder is None:
            publish = partial(self._bus.publish, CAMERA_IMAGE)
            self._encoder = JpegEncoder(self._jpeg_options, publish)
        return self._encoder

    def forward(self) -> None:
        """Publish the access units that arrived as camera/video, while somebody subscribes.

        They are numbered whether published or not, so that who listens later sees what is missing.
        """
        units = self._camera.access_units()
        wanted = bool(units) and self._bus.wanted(CAMERA_VIDEO)
        for unit in units:
            packet = self._packet(unit)
            if wanted:
                self._bus.publish(CAMERA_VIDEO, packet)
            if not self._frames:
                self._bus.health.output(unit.captured_ns, packet.header)

    def report(self) -> None:
        """Tell the health what the camera has met."""
        health, counts = self._bus.health, self._camera.counts
        for name in ("lost", "corrupt", "skipped", "late", "reconnects"):
            health.set(name, getattr(counts, name))
        health.set("end_of_file", float(self._camera.ended))
        while counts.problems:
            health.error(counts.problems.popleft())

    def close(self) -> None:
        """End the encoder."""
        if self._encoder is not None:
            self._encoder.close()

    def _moves(self, frame: Frame) -> bool:
        shown = self._gate.accept(fingerprint(frame))
        if self._gate.frozen:
            self._bus.health.add("frozen")
        if self._gate.just_frozen:
            self._bus.health.error(
                "the camera repeats its picture exactly, it is frozen: restart the camera; "
                "if its encoder repeats still scenes, set frozen_limit to 0"
            )
        return shown

    def _packet(self, unit: AccessUnit) -> VideoPacket:
        header = unit.header or self._stamp(self._units, unit.captured_ns)
        self._units += 1
        return VideoPacket.of(
            unit.payload, header=header, key_frame=unit.key_frame, lost_before=unit.lost_before
        )

    def _stamp(self, sequence: int, captured_ns: int) -> Stamp:
        bus = self._bus
        return Stamp(
            epoch=bus.epoch,
            sequence=sequence,
            time_ns=captured_ns,
            clock=bus.clock.id,
            uncertainty_ns=0,
        )
