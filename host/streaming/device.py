"""A device for its user, over any line."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import partial
from types import TracebackType
from typing import Any, NamedTuple, Self
from warnings import warn

from ...base.arguments import flag, real, shown, whole
from ...base.errors import DeviceError, DeviceLostError, DeviceRefusedError, DeviceStalledError
from ...protocol.blocks import AmplitudeModulation, Body, Entries, Entry, Output, PlaySequence, Samples, Slot, Update
from ...protocol.board import CARRIER_HZ
from ...protocol.codes import (
    ENTRIES_PER_BLOCK,
    NOW,
    SAMPLES_PER_BLOCK,
    SILENT_PERIODS,
    Action,
    Feature,
    Reason,
    Request,
)
from ...protocol.plain import flag_names
from ...protocol.pulses import Pulses
from ...protocol.replies import (
    Ack,
    ClockReading,
    Info,
    ProcessorReport,
    ReadBack,
    Status,
    decode_reports,
    decode_wiring,
)
from ...protocol.requests import VALUES
from ...protocol.wiring import Wiring
from ...solver import Solution, TransducerArray
from ..transports.opening import default_url, open_transport
from ..transports.transport import Timekeeper, Transport
from .calibration import Calibration
from .envelopes import Envelope
from .frames import Frame, Frames, differences, frame_source, to_pulses
from .lanes import Lane
from .session import Session
from .streaming import LOOK_AHEAD_SECONDS, Stream, StreamReport, time_to_play

__all__ = ["Device", "lane_of", "open_device", "streaming"]


class _Kept(NamedTuple):
    """A stored sequence or modulation of the device."""

    places: range
    period: int
    """The period from which it plays."""


def open_device(url: str | None = None, *, calibration: Calibration | None = None, observe: bool = False) -> Device:
    """Open a device by its URL.

    Parameters
    ----------
    url : str, optional
        ``emulator:`` (a fresh emulated device), ``emulator:SERIAL`` (an open `Emulator` of this process), ``usb:``
        (the only one), ``usb:SERIAL``, ``usbip:host:port`` (that of a USB/IP server), ``serial:///dev/ttyACM0?baud=…``,
        ``socket://host:port`` or ``rfc2217://host:port``. By default ``$PHASEWIRE_DEVICE``, else ``emulator:``.
    calibration : Calibration, optional
        The real emission of each transducer; drives are corrected for it on their way to pulses.
    observe : bool
        Whether to leave unchanged what the device plays, now and at the end. Its outputs are turned off otherwise.

    Returns
    -------
    Device
        Use it in a ``with`` statement: the outputs are off when it ends, however it ends.

    Raises
    ------
    DeviceError
        If no device answers, it may not be used, or it speaks another version of the protocol.
    """
    transport = open_transport(url if url is not None else default_url())
    try:
        return Device(transport, calibration=calibration, observe=observe)
    except BaseException:  # after any error the line must be closed
        transport.close()
        raise


class Device:
    """A device that plays pulses.

    Any thread may call any method at any time: calls wait for each other, and a stream lets others pass between its
    transfers, so that `stop` ends it within a few milliseconds, or when it has given up a lost device. Every method
    raises a `DeviceError` if the line or the device fails: `DeviceLostError` if the device went away,
    `DeviceTimeoutError` if it does not answer, `DeviceStalledError` if it does not carry out a request in its state.

    A *frame* argument is `Pulses`, a `Solution`, or a drive, (n,) complex of magnitude at most 1.
    A *period* is one of the device's clock (`clock`), `NOW` for as soon as possible.

    Parameters
    ----------
    transport : Transport
        The line to it.
    calibration : Calibration, optional
        The real emission of each transducer.
    observe : bool
        Whether to leave unchanged what plays, now and at the end.

    Attributes
    ----------
    calibration : Calibration or None
        The calibration as given.
    found : Status
        Its state when it was opened, before that changed anything: its settings are an earlier host's.
    """

    def __init__(self, transport: Transport, *, calibration: Calibration | None = None, observe: bool = False) -> None:
        self._observe = observe
        self._session = Session(transport)
        self.found = self._session.found
        self._enabled = False
        self._stops = 0
        self._streaming = False
        self._sequences, self._modulations = list[_Kept](), list[_Kept]()
        self._watchdog: float | None = None
        self._drive_limit: int | None = None
        self._envelope: tuple[bytes, int] | None = None
        self._compared: TransducerArray | None = None
        if calibration is not None and len(calibration) != self.channels:
            raise ValueError(f"the calibration is for {len(calibration)} transducers, the device has {self.channels}")
        self.calibration = calibration
        if not observe:
            self._session.begin()

    def __repr__(self) -> str:
        return f"Device({self.name})"

    @property
    def info(self) -> Info:
        """The device's description of itself."""
        return self._session.info

    @property
    def name(self) -> str:
        """Product and serial number."""
        return self._session.name

    @property
    def serial(self) -> str:
        """Serial number, empty if the line does not provide it."""
        return self._session.serial

    @property
    def stops(self) -> int:
        """How often its outputs were turned off by `stop`, `reset` or the end of ``with``, in any thread."""
        return self._stops

    @property
    def channels(self) -> int:
        """How many transducers it has."""
        return self.info.channels

    @property
    def slots(self) -> int:
        """How many frames it can store."""
        return self.info.slots

    @property
    def most_updates_per_second(self) -> float:
        """How many frames the device and the line to it can take."""
        return min(self.info.max_updates_per_second, self._session.line().most_blocks_per_second)

    @property
    def time(self) -> Timekeeper:
        """The clock of this device: the wall clock's, except for an emulated device in this process."""
        return self._session.time

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._stops += 1
        if self._session.foreign:
            return
        with self._session.lock:  # so that no other call plays between the two
            try:
                if not (self._observe or self._session.closed):
                    self._turn_off()
            except DeviceError:
                if kind is None:
                    raise
            except BaseException:  # Ctrl-C came at this moment: stop first
                with suppress(DeviceError):
                    self._turn_off()
                raise
            finally:
                self._session.end()

    def close(self) -> None:
        """Close the line and leave the device as it is, even playing; ``with`` then ends without a stop.

        A stream, or a call that a signal's handler has interrupted, ends in a `DeviceError`, with outputs off.
        """
        if not self._session.foreign:
            with self._session.lock as interrupted:
                if self._streaming and not interrupted:
                    self._silence_after_failure()
        self._session.close()

    # Its description and state

    def status(self) -> Status:
        """The state of the device; a sign of life to its watchdog."""
        return self._session.status()

    def clock(self) -> ClockReading:
        """The device's time, and the last pulse on its sync line."""
        return self._session.query(ClockReading.decode, Request.CLOCK)

    def wiring(self) -> Wiring:
        """The table by which the device sorts transducers to its outputs."""
        return self._session.query(decode_wiring, Request.WIRING)

    def processors(self) -> list[ProcessorReport]:
        """The last report of each of the ten processors, in the order of the chain."""
        return self._session.query(decode_reports, Request.PROCESSORS)

    def read_back(self) -> ReadBack:
        """The pulses that play now, as read from the processors, before any modulation."""
        self._need(Feature.READ_BACK)
        return self._session.query(ReadBack.decode, Request.PULSES)

    # Switches

    def enable(self) -> None:
        """Enable the outputs, which `show`, `play` and `stream` do by themselves.

        Raises
        ------
        DeviceStalledError
            If a fault silences the outputs; it is named.
        """
        with self._session.lock:
            try:
                self._session.command(Request.ENABLE)
            except DeviceStalledError as error:
                status = self.status()
                faults = flag_names(status.faults)
                why = f"a fault has silenced it ({faults}); `phasewire doctor` says what to do" if faults else "not now"
                raise DeviceStalledError(
                    f"{self.name} does not enable its outputs in {status.state.name}: {why}"
                ) from error
            self._enabled = True

    def stop(self) -> None:
        """Turn all outputs off and drop what is queued; what is stored stays. A stream in another thread ends."""
        self._stops += 1  # before waiting for the lock, which a stream holds while a lost device comes back
        self._turn_off()

    def _turn_off(self) -> None:
        with self._session.lock:
            self._enabled = False
            self._envelope = None
            self._session.command(Request.DISABLE)

    def reset(self) -> None:
        """Restart the device as at power-up, and open it again when it returns: its stores are empty."""
        self._stops += 1
        with self._session.lock:
            self._enabled = False
            with suppress(DeviceLostError):  # it may be gone before it has answered
                self._session.command(Request.RESET)
            self._session.wait_until_gone()
            self.reopen()

    def reopen(self) -> None:
        """Open it again after it was lost, when it comes back, with its outputs off and its stores empty.

        Raises
        ------
        DeviceLostError
            If it does not come back within some seconds.
        """
        with self._session.lock:
            self._enabled = False
            self._session.reopen()
            self._forget()

    def identify(self, board: int) -> None:
        """Let the light on a board blink for five seconds."""
        self._order(Request.IDENTIFY, "board", board)

    def set_watchdog(self, seconds: float) -> None:
        """How long the device waits for a sign of life before it turns its outputs off, 0.01 to 60 s."""
        seconds = real("seconds", seconds, VALUES[Request.WATCHDOG][0] / 1000, VALUES[Request.WATCHDOG][-1] / 1000, "s")
        with self._session.lock:
            self.status()  # a sign of life, because the last one may be older than a shorter time
            self._order(Request.WATCHDOG, "watchdog time in ms", round(seconds * 1000))
            self._watchdog = seconds

    def set_drive_limit(self, transducers: int) -> None:
        """Set the drive limit, in full transducers; only while the outputs are off."""
        self._order(Request.LIMIT, "drive limit", transducers)
        self._drive_limit = transducers

    def clear_faults(self) -> Status:
        """Clear the faults whose cause is gone, and return the others."""
        with self._session.lock:
            self._session.command(Request.CLEAR_FAULTS)
            return self.status()

    def _order(self, request: Request, what: str, value: int) -> None:
        self._session.command(request, whole(what, value, VALUES[request][0], VALUES[request][-1]))

    # Playing

    def show(self, frame: Frame, period: int = NOW) -> Ack:
        """Play a frame until something else follows or the host falls silent.

        The outputs are enabled first if they are not. The device turns them off when it hears nothing for its
        watchdog's time; `status` is a sign of life. If a solution is for another array or carrier than the device's,
        there is a warning.

        Parameters
        ----------
        frame : Pulses, Solution or (n,) complex
            The frame.
        period : int
            Its first period.

        Returns
        -------
        Ack
            Contains the period at which it begins, and whether that is later than requested.

        Raises
        ------
        ValueError
            If the frame does not fit the device; nothing is sent.
        DeviceRefusedError
            If the device refuses it.
        """
        return self._play(Update(self._pulses(frame), period))

    def _pulses(self, frame: Frame) -> Pulses:
        pulses = to_pulses(frame, self.calibration, self.channels)
        if isinstance(frame, Solution) and frame.array is not self._compared:  # once for all of a live solver
            self._compared = frame.array
            for difference in differences(frame.array, frame.medium, self.info):
                warn(f"the solution was made for something else: {difference}", stacklevel=3)
        return pulses

    def store(self, slot: int, frame: Frame) -> Ack:
        """Store a frame in a numbered slot, 0 to `info.slots` - 1, for `play`.

        Raises
        ------
        ValueError
            If the frame or the number does not fit the device; nothing is sent.
        DeviceRefusedError
            If the device refuses it, as while a sequence plays that slot.
        """
        self._need(Feature.SEQUENCES)
        return self._sent(Slot(slot, self._pulses(frame)))

    def play(
        self,
        steps: Iterable[tuple[int, int]],
        *,
        repeats: int = 0,
        unattended: bool = False,
        period: int = NOW,
    ) -> Ack:
        """Play stored slots one after the other, repeatedly, without further help of the host.

        The outputs are enabled first if they are not. While another sequence plays, this one is stored beside it if
        both have room.

        Parameters
        ----------
        steps : iterable of (slot, periods)
            The slots, and for how many carrier periods each; 1 to `info.sequence_entries`.
        repeats : int
            How many times; 0 for as long as nothing else follows.
        unattended : bool
            Whether it goes on when the host falls silent.
        period : int
            Its first period.

        Raises
        ------
        ValueError
            If a step is out of range; nothing is sent.
        DeviceRefusedError
            If the device refuses it, as for an empty slot, or if it would have to overwrite what plays.
        """
        self._need(Feature.SEQUENCES | (Feature.UNATTENDED if unattended else Feature(0)))
        if not isinstance(steps, Iterable):
            raise ValueError(f"steps {shown(steps)} must be pairs of a slot and a number of periods")
        entries = [Entry(*step) for step in steps]
        with self._session.lock:
            first = self._place(self._sequences, len(entries), self.info.sequence_entries, "steps")
            body = PlaySequence(first, len(entries), period, repeats, unattended)
            self._sent(
                *(Entries(tuple(part), first + at) for at, part in _parts(entries, ENTRIES_PER_BLOCK)),
            )
            ack = self._play(body)
            self._sequences.append(_Kept(range(first, first + len(entries)), ack.commit_period))
            return ack

    def modulate(self, samples: Sequence[int] | bytes, hold: int, period: int = NOW) -> Ack:
        """Modulate whatever plays with amplitudes, repeatedly, until `end_modulation`.

        Parameters
        ----------
        samples : bytes or sequence of int
            Amplitudes, 0 (silent) to 255 (as it is); 1 to `info.modulation_samples`.
        hold : int
            How many carrier periods each holds: 40 000 / (hold · number of samples) is the frequency in Hz.
        period : int
            Its first period.

        Raises
        ------
        ValueError
            If a value is out of range; nothing is sent.
        DeviceRefusedError
            If the device refuses it.
        """
        if isinstance(samples, Envelope) or isinstance(hold, Envelope) or not isinstance(samples, Iterable):
            raise ValueError(
                f"samples {shown(samples)} must be amplitudes, with a hold, as in modulate(*sine(200)); they modulate "
                "whatever plays"
            )
        self._need(Feature.MODULATION)
        values = (
            samples
            if isinstance(samples, bytes)
            else bytes(whole("one of the samples", each, 0, 255) for each in samples)
        )
        with self._session.lock:
            first = self._place(self._modulations, len(values), self.info.modulation_samples, "samples")
            body = AmplitudeModulation(first, len(values), hold, period)
            self._sent(*(Samples(part, first + at) for at, part in _parts(values, SAMPLES_PER_BLOCK)))
            ack = self._play(body)
            self._modulations.append(_Kept(range(first, first + len(values)), ack.commit_period))
            self._envelope = (values, hold)
            return ack

    def end_modulation(self, period: int = NOW) -> Ack:
        """End the modulation of what plays."""
        self._need(Feature.MODULATION)
        self._envelope = None
        return self._play(Output(Action.END_MODULATION, period))

    def silence(self, period: int = NOW) -> Ack:
        """End what plays, and its modulation; the outputs stay enabled."""
        self._envelope = None
        return self._play(Output(Action.SILENCE, period))

    def keep_playing(self, seconds: float) -> None:
        """Let what plays go on for a time, or without end if that is infinite, with signs of life to the watchdog.

        Raises
        ------
        DeviceRefusedError
            If the device has turned its outputs off meanwhile.
        """
        end = self.time.monotonic() + time_to_play(seconds)
        while (left := end - self.time.monotonic()) > 0:
            self.time.sleep(min(self._session.pause_seconds, left))
            self._session.check_enabled()

    def stream(
        self,
        source: Frames,
        rate: float,
        *,
        look_ahead: float = LOOK_AHEAD_SECONDS,
        envelope: Envelope | None = None,
        reconnect: bool = False,
        on_progress: Callable[[StreamReport], None] | None = None,
    ) -> StreamReport:
        """Play frames one after the other at a rate, each in its own period, to the end of the last.

        Parameters
        ----------
        source : (k, n) complex, PulseFrames, Recording, or iterable of frames
            A frame is taken from an iterable when it is due, not before.
        rate : float
            Frames per second, at most `info.max_updates_per_second`.
        look_ahead : float
            How long before its period a frame is sent, in seconds, if the device's queue allows that. More bridges
            longer gaps of the source or the host, less lets a live source react sooner.
        envelope : Envelope, optional
            A modulation of the frames, as by `modulate`: `sine(200)` makes them perceptible.
        reconnect : bool
            Whether to go on with the next frame when a lost device comes back, with its earlier drive limit, watchdog
            time and modulation. Frames that may have arrived are not sent again.
        on_progress : callable, optional
            Called with the present report some ten times a second, and at the end of any kind.

        Returns
        -------
        StreamReport
            The fate of every frame.

        Raises
        ------
        ValueError
            If rate or look-ahead is out of range, or a frame does not fit the device.
        DeviceRefusedError
            If the device refuses a frame, as after `stop` or after its watchdog has fired.
        DeviceError
            If the line or the device fails. After any error the outputs are off, or will be after the watchdog's time
            if the device cannot be reached.
        """
        frames, lane = frame_source(source, self.calibration, self.channels), lane_of(self, envelope)
        if flag("reconnect", reconnect):
            lane.restore = partial(self._come_back, lane.permit)
        stream = Stream([lane], frames, rate, look_ahead=look_ahead)
        try:
            with streaming(self, lane):
                return stream.run(on_progress)
        finally:
            if on_progress is not None:
                on_progress(stream.report)

    def _check_not_stopped(self, stops: int) -> None:
        """Raise `DeviceRefusedError` if the device was stopped since a stream was requested."""
        if self._stops != stops:
            raise DeviceRefusedError(f"{self.name} has turned its outputs off: it was stopped", Reason.DISABLED)

    def _come_back(self, permit: Callable[[], None]) -> None:
        """Open the device again when it returns, and restore it for a stream that may go on."""
        with self._session.lock:
            self._session.reopen()
            permit()
            self._restore()

    def _begin_stream(self, envelope: Envelope | None) -> None:
        self.enable()
        if envelope is not None:
            self.modulate(*envelope)

    def _forget(self) -> None:
        """The settings that the device holds: none, as after a restart."""
        self._sequences, self._modulations = list[_Kept](), list[_Kept]()
        self._watchdog = self._drive_limit = self._envelope = None

    def _restore(self) -> None:
        """Restore a device after its restart: limit, watchdog, modulation, enabled; not its slots."""
        watchdog, drive_limit, envelope = self._watchdog, self._drive_limit, self._envelope
        self._turn_off()  # it may be unchanged, and play on
        self._forget()
        if drive_limit is not None:
            self.set_drive_limit(drive_limit)
        if watchdog is not None:
            self.set_watchdog(watchdog)
        self.enable()
        if envelope is not None:
            self.modulate(*envelope)

    def _silence_after_failure(self) -> None:
        try:
            self._turn_off()
        except DeviceError:  # out of reach: its watchdog does it
            self._enabled = False

    def _need(self, feature: Feature) -> None:
        missing = feature & ~self.info.features
        if missing:
            raise DeviceError(f"{self.name} lacks the feature {missing.name}; `phasewire info` lists what it has")

    def _place(self, kept: list[_Kept], count: int, places: int, what: str) -> int:
        """The place for data that must not overwrite what may be playing: after it, or else at the beginning.

        Stored data are in use until the next stored ones have begun or, for the last, until the outputs are silent
        (clause BLK-022); if that is soon, wait for it.
        """
        whole(f"number of {what}", count, 1, places)
        begin = kept[-1].places.stop if kept else 0
        first = begin if begin + count <= places else 0
        overwritten = [
            at for at, each in enumerate(kept) if first < each.places.stop and each.places.start < first + count
        ]
        if overwritten:
            after = kept[overwritten[-1] + 1 :]
            now = self.status().period
            left = max(after[0].period - now, 0) + 1 if after else SILENT_PERIODS + 1
            self.time.sleep(min(left / CARRIER_HZ, self._session.pause_seconds))
            del kept[: overwritten[-1] + 1]
        return first

    def _play(self, body: Body) -> Ack:
        """Send a change, with the outputs enabled."""
        with self._session.lock:
            if not self._enabled:
                self.enable()
            return self._sent(body)

    def _sent(self, *bodies: Body) -> Ack:
        """Send blocks; returns the answer to the last."""
        try:
            return self._session.send(*bodies)[-1]
        except DeviceError:
            self._enabled = False  # ask again: ENABLE is a sign of life if they are
            raise


def lane_of(device: Device, envelope: Envelope | None = None) -> Lane:
    """The lane of a device in a stream, modulated by an envelope; a stop of the device from now on ends the stream."""
    permit = partial(device._check_not_stopped, device.stops)
    return Lane(device._session, permit=permit, begin=partial(device._begin_stream, envelope))


@contextmanager
def streaming(device: Device, lane: Lane) -> Iterator[None]:
    """Play a stream in a lane of a device, and no other meanwhile; after a failure the outputs are off.

    Raises
    ------
    DeviceError
        If the device plays a stream already.
    """
    with device._session.lock:
        if device._streaming:
            raise DeviceError(f"{device.name} plays a stream already; wait for its end, or stop it")
        device._streaming = True
    try:
        yield
    except BaseException:
        with suppress(DeviceRefusedError):
            lane.permit()  # otherwise they are off, or play what began since
            device._silence_after_failure()
        raise
    finally:
        device._streaming = False


def _parts(items: Any, most: int) -> list[tuple[int, Any]]:
    """A sequence in pieces of at most so many items, each with its place."""
    return [(at, items[at : at + most]) for at in range(0, len(items), most)]
