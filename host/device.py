"""A device as its user sees it, whatever line leads to it."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from types import TracebackType
from typing import Self, TypeVar

from ..errors import DeviceError, DeviceRefusedError, ReplyError
from ..protocol.blocks import Block, Update, pack
from ..protocol.codes import NOW, PROTOCOL_VERSION, Reason, Request
from ..protocol.numbering import follows, successor
from ..protocol.pulses import Pulses
from ..protocol.replies import WIRING_BYTES, Ack, Info, Status, decode_wiring, records
from ..protocol.wiring import Wiring
from .transport import Transport, default_url, open_transport

__all__ = ["Device", "open_device"]

Answer = TypeVar("Answer")


def open_device(url: str | None = None) -> Device:
    """Open a device by its URL.

    Parameters
    ----------
    url : str, optional
        ``emulator:`` (a fresh emulated device), ``emulator:SERIAL`` (one that this process has plugged in), ``usb:`` or
        ``usb:SERIAL``. By default ``$PHASEWIRE_DEVICE``, else ``emulator:``.

    Returns
    -------
    Device
        Use it in a ``with`` statement: the outputs are off when it ends, however it ends.

    Raises
    ------
    DeviceError
        Where nothing answers, it may not be used, or it speaks another version of the protocol.
    """
    transport = open_transport(url if url is not None else default_url())
    try:
        return Device(transport)
    except BaseException:  # whatever it was, the line is not ours to keep
        transport.close()
        raise


class Device:
    """A device that plays pulses. Not thread-safe.

    Parameters
    ----------
    transport : Transport
        The line to it.

    Attributes
    ----------
    info : Info
        What the device says that it is.
    """

    def __init__(self, transport: Transport) -> None:
        self._transport = transport
        self._records: deque[Ack | Status] = deque()
        self._sequence = 0
        self._restart = True
        self._enabled = False
        self._closed = False
        self.info = self._read(Info.decode, transport.ask(Request.INFO, Info.BYTES))
        if not self.info.speaks(PROTOCOL_VERSION):
            raise DeviceError(
                f"{transport.name} speaks versions {self.info.oldest_version} to {self.info.newest_version} of the "
                f"protocol, this is version {PROTOCOL_VERSION}; update the older of the two"
            )

    @property
    def name(self) -> str:
        """Product and serial number."""
        return self._transport.name

    @property
    def _line(self) -> Transport:
        if self._closed:
            raise DeviceError(f"{self.name} is closed; open it again")
        return self._transport

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        try:
            self.stop()
        except DeviceError:
            if kind is None:
                raise
        finally:
            self._closed = True
            self._transport.close()

    def show(self, pulses: Pulses, period: int = NOW) -> Ack:
        """Play pulses from a carrier period on, until others follow or the host falls silent.

        The outputs are enabled first if they are not. The device turns them off when it hears nothing for
        ``info.watchdog`` seconds; `status` is a sign of life.

        Parameters
        ----------
        pulses : Pulses
            One per transducer.
        period : int
            Carrier period of the device's clock (`status`) at which to begin; as soon as possible by default.

        Returns
        -------
        Ack
            Says at which period they begin, and whether that is later than asked for.

        Raises
        ------
        ValueError
            Where the number of pulses is not the device's; nothing is sent.
        DeviceRefusedError
            Where the device refuses the block.
        DeviceError
            Where the line or the device fails.
        """
        if len(pulses) != self.info.channels:
            raise ValueError(f"{len(pulses)} pulses for a device with {self.info.channels} transducers")
        sequence = self._sequence
        block = pack(Block(Update(pulses, period), sequence, self._restart))
        if not self._enabled:
            self._line.order(Request.ENABLE)
            self._enabled = True
        # Used up once the block is on its way, whatever becomes of it.
        self._sequence, self._restart = successor(sequence), False
        self._line.write_block(block)
        return self._await_ack(sequence)

    def _await_ack(self, sequence: int) -> Ack:
        """The acknowledgement of a block; those of blocks that were given up before are passed over."""
        ack = self._next_ack()
        while follows(sequence, ack.sequence):
            ack = self._next_ack()
        if ack.reason is Reason.DISABLED:
            self._enabled = False
            raise DeviceRefusedError(
                f"{self.name} has turned its outputs off, as it does without a sign of life for "
                f"{self.info.watchdog:g} s; show again to enable them",
                ack.reason,
            )
        if ack.reason is not Reason.ACCEPTED:
            raise DeviceRefusedError(f"{self.name} refuses block {ack.sequence}: {ack.reason.text}", ack.reason)
        if ack.sequence != sequence:
            raise DeviceError(f"{self.name} acknowledges block {ack.sequence}, not {sequence}; open it again")
        return ack

    def _next_ack(self) -> Ack:
        """The next acknowledgement; what the device says of its state by itself is passed over."""
        while True:
            while not self._records:
                self._records += self._read(records, self._line.read_records())
            if isinstance(record := self._records.popleft(), Ack):
                return record

    def stop(self) -> None:
        """Turn all outputs off and drop what is queued."""
        self._line.order(Request.DISABLE)
        self._enabled = False

    def status(self) -> Status:
        """What the device is doing now."""
        return self._read(Status.decode, self._line.ask(Request.STATUS, Status.BYTES))

    def wiring(self) -> Wiring:
        """The table by which the device sorts transducers to its outputs."""
        return self._read(decode_wiring, self._line.ask(Request.WIRING, WIRING_BYTES))

    def _read(self, decode: Callable[[bytes], Answer], data: bytes) -> Answer:
        try:
            return decode(data)
        except ReplyError as error:
            raise DeviceError(f"{self.name} answers in a way that breaks the protocol: {error}") from error
