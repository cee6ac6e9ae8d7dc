"""The raw line of firmware upgrade: any DFU request in either mode of the device, and whole downloads.

It polls no earlier than the device allows (clause DFU-008), and otherwise only does what a case asks for.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from ....host.transports.usb_find import DFU_MODE, RUN_TIME
from ....protocol.codes import (
    CLASS_REQUEST_TYPE_IN,
    CLASS_REQUEST_TYPE_OUT,
    DFU_TRANSFER_BYTES,
    IMAGE_MAX_BYTES,
    DfuRequest,
    DfuState,
)
from ....protocol.dfu import DfuReply
from ....protocol.enumeration import DFU_INTERFACE, LANGUAGE
from ....protocol.requests import DIRECTION_IN, Setup
from ..bench import Bench

DETACH_MS = 1000
SPARE_MS = 10
"""Extra wait if the busy time itself is not judged: polling too early ends a download."""
MOST_POLLS = 200
BUSY = (DfuState.DNBUSY, DfuState.MANIFEST)
STRING = 3
GET_DESCRIPTOR = 6


class RawDfuLine:
    """DFU requests to a device; `detached` is the host's time when DETACH was last answered, in seconds."""

    def __init__(self, bench: Bench) -> None:
        self.detached: float | None = None
        self._downloaded = 0.0
        self._bench = bench
        self._usb = bench.usb
        if self._usb.mode == RUN_TIME:
            bench.measure_pace()

    def request(self, request: int, value: int = 0, length: int = 0, data: bytes = b"") -> bytes | None:
        """Make any class request to the DFU interface; returns the answer, or None for STALL. A length makes it IN."""
        interface = 0 if self._usb.mode == DFU_MODE else DFU_INTERFACE
        kind = CLASS_REQUEST_TYPE_IN if length else CLASS_REQUEST_TYPE_OUT
        return self._bench.request(Setup(kind, request, value, interface, length or len(data)), data)

    def status(self) -> DfuReply | None:
        """GETSTATUS; None for STALL."""
        answer = self.request(DfuRequest.GETSTATUS, length=DfuReply.BYTES)
        return None if answer is None else DfuReply.decode(answer)

    def state(self) -> DfuState | None:
        """GETSTATE; None for STALL."""
        answer = self.request(DfuRequest.GETSTATE, length=1)
        return None if answer is None else DfuState(answer[0])

    def detach(self) -> bool:
        """DETACH; returns False for STALL."""
        answered = self.request(DfuRequest.DETACH, DETACH_MS) is not None
        if answered:
            self.detached = self._bench.line.time.monotonic()
        return answered

    def download(self, number: int, data: bytes) -> bool:
        """DNLOAD of one block, or its end without data; returns False for STALL."""
        self._downloaded = self._bench.line.time.monotonic()
        return self.request(DfuRequest.DNLOAD, number, data=data) is not None

    @property
    def since_download(self) -> float:
        """How long ago the last DNLOAD began, in seconds of the host's time."""
        return self._bench.line.time.monotonic() - self._downloaded

    def upload(self, number: int, length: int = DFU_TRANSFER_BYTES) -> bytes | None:
        """UPLOAD of one block; None for STALL."""
        return self.request(DfuRequest.UPLOAD, number, length)

    def abort(self) -> bool:
        """ABORT; returns False for STALL."""
        return self.request(DfuRequest.ABORT) is not None

    def clear(self) -> bool:
        """CLRSTATUS; returns False for STALL."""
        return self.request(DfuRequest.CLRSTATUS) is not None

    def string(self, index: int) -> str | None:
        """A string descriptor; None for STALL."""
        answer = self._bench.request(Setup(DIRECTION_IN, GET_DESCRIPTOR, STRING << 8 | index, LANGUAGE, 255))
        return None if answer is None else answer[2:].decode("utf-16-le")

    def wait(self, milliseconds: float) -> None:
        """Let time pass on the device, which has no clock to ask for in DFU mode: by its pace before."""
        self._bench.wait(self._bench.paced(milliseconds / 1000))

    # Steps of more than one request

    def poll(self) -> DfuReply:
        """Ask for the status while the device says that it is busy, no earlier than it allows; it must end."""
        for _ in range(MOST_POLLS):
            reply = self.status()
            assert reply is not None, "GETSTATUS is answered with STALL"
            if reply.state not in BUSY:
                return reply
            held_up = reply.poll_ms if self._bench.is_far else 0  # an emulated device on a busy computer
            self.wait(reply.poll_ms + SPARE_MS + held_up)
        raise AssertionError(f"the device is still busy after {MOST_POLLS} polls")

    def send(self, image: bytes, first: int = 0, last: int | None = None) -> DfuReply:
        """Download blocks of an image, up to the last or the first that is refused or fails; returns the last poll."""
        blocks = [image[at : at + DFU_TRANSFER_BYTES] for at in range(0, len(image), DFU_TRANSFER_BYTES)]
        reply: DfuReply | None = None
        for number in range(first, len(blocks) if last is None else last):
            taken = self.download(number, blocks[number])
            reply = self.poll()
            if not taken or reply.state is DfuState.ERROR:
                break
        return reply or self.poll()  # there may be no block to send

    def end(self) -> DfuReply:
        """End a download, and wait until the image is judged."""
        assert self.download(0, b""), "a DNLOAD without data after the last block is answered with STALL"
        return self.poll()

    def flash(self, image: bytes) -> None:
        """Download an image that must be accepted."""
        reply = self.send(image)
        assert reply.state is DfuState.DNLOAD_IDLE, f"the download ends in {reply.state.name}, {reply.status.name}"
        reply = self.end()
        assert reply.state is DfuState.DFU_IDLE, f"manifestation ends in {reply.state.name}, {reply.status.name}"

    def image(self) -> bytes:
        """Upload the image that would boot next."""
        found, number = b"", 0
        while True:
            block = self.upload(number)
            assert block is not None, f"UPLOAD of block {number} is answered with STALL"
            found += block
            if len(block) < DFU_TRANSFER_BYTES:
                return found
            assert len(found) <= IMAGE_MAX_BYTES, (
                f"the upload goes on after {IMAGE_MAX_BYTES} bytes, the size of the largest image"
            )
            number += 1

    def own_image(self) -> bytes:
        """Upload the image that would boot next, and go back to dfuIDLE."""
        image = self.image()
        self.rest()
        return image

    def rest(self) -> None:
        """Reach dfuIDLE from any state in which requests are answered, or that ends by itself."""
        for _ in range(4):
            state = self.state()
            if state is None:  # busy: asking was an error
                state = self.state()
            if state is DfuState.DFU_IDLE:
                return
            if state is DfuState.ERROR:
                self.clear()
            elif state in (DfuState.DNLOAD_IDLE, DfuState.UPLOAD_IDLE):
                self.abort()
            else:
                self.poll()
        raise AssertionError(f"the device does not come to rest; it is in {state.name if state is not None else '?'}")

    def enter(self) -> None:
        """Go to DFU mode."""
        assert self.detach(), "DETACH is answered with STALL"
        self._usb.wait_for(DFU_MODE, self._bench.return_seconds)

    def leave(self) -> None:
        """Boot by a bus reset, and wait for run-time mode."""
        self._usb.reset()
        self._usb.wait_for(RUN_TIME, self._bench.return_seconds)


@contextmanager
def dfu_mode(bench: Bench) -> Iterator[RawDfuLine]:
    """A device in DFU mode, returned to run-time mode however the case ends."""
    line = RawDfuLine(bench)
    line.enter()
    try:
        yield line
    finally:
        if bench.usb.mode == DFU_MODE:
            line.leave()
