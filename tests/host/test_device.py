from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from phasewire import Emulator, Pulses, Wiring, open_device
from phasewire.emulator.doors.backend import Port
from phasewire.errors import DeviceError, DeviceLostError, DeviceRefusedError, DeviceTimeoutError
from phasewire.host.session import Session
from phasewire.protocol import Ack, Info, Reason, Request, State, unpack
from phasewire.protocol.codes import AckFlag

FULL = Pulses(np.full(320, 25), np.full(320, 25))


def sounding(emulator: Emulator) -> int:
    """Transducers that sound in the last period."""
    emulator.run(5)
    capture = emulator.capture()
    return int((np.abs(capture.drive(capture.periods - 1)) > 0).sum())


def test_show_plays_and_stop_stops(emulator: Emulator) -> None:
    with open_device(emulator.url) as device:
        assert sounding(emulator) == 0
        device.show(FULL)
        assert sounding(emulator) == 320
        device.stop()
        assert sounding(emulator) == 0
        device.show(FULL)
        assert sounding(emulator) == 320
        assert Port.of(emulator.usb).claims
    assert not Port.of(emulator.usb).claims


def test_ctrl_c_while_the_outputs_are_turned_off_does_not_leave_them_on(
    emulator: Emulator, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It comes once: `phasewire` passes over the others."""
    genuine, interrupts = Session.order, iter([KeyboardInterrupt])

    def order(session: Session, request: Request, value: int = 0) -> None:
        if request is Request.DISABLE and (error := next(interrupts, None)):
            raise error
        genuine(session, request, value)

    def session() -> None:
        with open_device(emulator.url) as device:
            device.show(FULL)
            monkeypatch.setattr(Session, "order", order)

    with pytest.raises(KeyboardInterrupt):
        session()
    assert sounding(emulator) == 0
    assert not Port.of(emulator.usb).claims


@pytest.mark.parametrize("error", [None, KeyboardInterrupt, RuntimeError])
def test_the_outputs_are_off_however_the_session_ends(emulator: Emulator, error: type[BaseException] | None) -> None:
    def session() -> None:
        with open_device(emulator.url) as device:
            device.show(FULL)
            emulator.run(5)
            if error:
                raise error

    if error:
        with pytest.raises(error):
            session()
    else:
        session()
    assert sounding(emulator) == 0


def test_an_update_can_name_its_period(emulator: Emulator) -> None:
    with open_device(emulator.url) as device:
        now = device.status().period
        ack = device.show(FULL, period=now + 40)
        assert (ack.commit_period, ack.late) == (now + 40, False)
        assert device.show(FULL, period=1).late


def test_sequence_numbers_count_and_wrap(emulator: Emulator) -> None:
    with open_device(emulator.url) as device:
        assert [device.show(FULL).sequence for _ in range(3)] == [0, 1, 2]
        device._sequence, device._restart = 2**32 - 1, True
        assert [device.show(FULL).sequence for _ in range(2)] == [2**32 - 1, 0]


def test_numbering_restarts_once_in_a_session(emulator: Emulator, monkeypatch: pytest.MonkeyPatch) -> None:
    with open_device(emulator.url) as device:
        sent: list[bytes] = []
        genuine = device._transport.write_block

        def noting(block: bytes) -> None:
            sent.append(block)
            genuine(block)

        monkeypatch.setattr(device._transport, "write_block", noting)
        for _ in range(3):
            device.show(FULL)
    assert [unpack(block).restart for block in sent] == [True, False, False]


def test_info_and_status_tell_the_truth(emulator: Emulator) -> None:
    with open_device(emulator.url) as device:
        assert (device.info.channels, device.info.boards, device.info.max_updates_per_second) == (320, 5, 40_000)
        assert device.info.watchdog == 0.1
        assert not device.status().enabled
        device.show(FULL)
        status = device.status()
        assert (status.enabled, status.accepted, status.refused) == (True, 1, 0)


def test_the_wiring_table_can_be_read(scrambled: Wiring) -> None:
    with Emulator(table=scrambled) as emulator, open_device(emulator.url) as device:
        assert device.wiring().channels.tolist() == scrambled.channels.tolist()


def test_the_wrong_number_of_pulses_sends_nothing(emulator: Emulator) -> None:
    with open_device(emulator.url) as device:
        with pytest.raises(ValueError, match="12 pulses for a device with 320 transducers"):
            device.show(Pulses.silent(12))
        assert not device.status().enabled
        assert device.status().refused == 0


def test_a_refusal_gives_its_reason_and_the_session_goes_on(emulator: Emulator) -> None:
    with open_device(emulator.url) as device:
        device.show(FULL)
        device._transport.order(Request.DISABLE)  # behind the session's back, as a watchdog would
        with pytest.raises(
            DeviceRefusedError, match=r"has turned its outputs off, .* show again to enable them"
        ) as refused:
            device.show(FULL)
        assert refused.value.reason == Reason.DISABLED
        device.show(FULL)
        assert sounding(emulator) == 320


def test_after_the_watchdog_it_can_be_shown_again(emulator: Emulator) -> None:
    with open_device(emulator.url) as device:
        device.show(FULL)
        emulator.run(5000)
        with pytest.raises(DeviceRefusedError, match=r"without a sign of life for 0.1 s"):
            device.show(FULL)
        device.show(FULL)
        assert sounding(emulator) == 320


def test_a_late_acknowledgement_is_not_taken_for_the_next_block_s(
    emulator: Emulator, monkeypatch: pytest.MonkeyPatch
) -> None:
    with open_device(emulator.url) as device:
        device.show(FULL)
        with monkeypatch.context() as patch:
            patch.setattr(device._transport, "read_records", raise_timeout)
            with pytest.raises(DeviceTimeoutError):
                device.show(FULL, period=500)
        ack = device.show(FULL, period=1000)
        assert (ack.sequence, ack.commit_period) == (2, 1000)


def raise_timeout() -> bytes:
    raise DeviceTimeoutError("waiting for an acknowledgement: no answer")


def test_a_closed_device_does_nothing_more(emulator: Emulator) -> None:
    with open_device(emulator.url) as device:
        device.show(FULL)
    for use in (lambda: device.show(FULL), device.status, device.stop, device.wiring):
        with pytest.raises(DeviceError, match="is closed; open it again"):
            use()
    assert sounding(emulator) == 0


def test_a_queue_of_distant_updates_is_dropped_on_stop(emulator: Emulator) -> None:
    with open_device(emulator.url) as device:
        for n in range(8):
            device.show(FULL, 10**6 + n)
        device.stop()
        assert device.show(FULL).free == 7


@pytest.mark.parametrize("period", [1.5, "soon"])
def test_a_period_is_a_whole_number(emulator: Emulator, period: object) -> None:
    with open_device(emulator.url) as device, pytest.raises(TypeError, match="integer"):
        device.show(FULL, period)  # type: ignore[arg-type]  # the wrong type is the point


def test_a_period_beyond_the_horizon_is_refused(emulator: Emulator) -> None:
    with open_device(emulator.url) as device:
        with pytest.raises(DeviceRefusedError, match=r"more than 2\*\*32 ahead"):
            device.show(FULL, 2**64 - 1)
        device.show(FULL)


def test_unplugging_raises_and_closes(emulator: Emulator) -> None:
    other = Emulator(serial="SHORT-LIVED")
    with other:
        device = open_device(other.url)
    with pytest.raises(DeviceLostError, match="the device is gone; plug it in again"):
        device.show(FULL)
    with pytest.raises(DeviceLostError), device:
        pass


def test_an_error_within_the_session_is_not_hidden_by_a_lost_device() -> None:
    def session() -> None:
        emulator = Emulator(serial="PULLED")
        with emulator:
            device = open_device(emulator.url)
        with device:
            raise RuntimeError("the first thing that went wrong")

    with pytest.raises(RuntimeError, match="the first thing"):
        session()


def test_a_device_that_does_not_acknowledge_times_out(emulator: Emulator, monkeypatch: pytest.MonkeyPatch) -> None:
    with open_device(emulator.url) as device:
        monkeypatch.setattr("phasewire.emulator.control.controller.Controller.accept", lambda self, packet, door: None)
        with pytest.raises(DeviceTimeoutError, match="waiting for an acknowledgement: no answer within 1000 ms"):
            device.show(FULL)


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (b"junk", "breaks the protocol"),
        (Ack(Reason.ACCEPTED, 77, 1, 1, AckFlag(0), 8, State.READY).encode(), "acknowledges block 77, not 0"),
    ],
)
def test_an_acknowledgement_that_makes_no_sense_is_an_error(
    emulator: Emulator, monkeypatch: pytest.MonkeyPatch, answer: bytes, message: str
) -> None:
    with open_device(emulator.url) as device:
        monkeypatch.setattr(device._transport, "read_records", lambda: answer)
        with pytest.raises(DeviceError, match=message):
            device.show(FULL)


def test_another_version_of_the_protocol_is_refused(emulator: Emulator, monkeypatch: pytest.MonkeyPatch) -> None:
    genuine = Info.encode
    newer = {"oldest_version": 2, "newest_version": 3}
    monkeypatch.setattr(Info, "encode", lambda self: genuine(dataclasses.replace(self, **newer)))
    with pytest.raises(DeviceError, match="speaks versions 2 to 3 of the protocol, this is version 1; update"):
        open_device(emulator.url)


def test_an_information_record_that_makes_no_sense_is_an_error(
    emulator: Emulator, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Info, "encode", lambda self: bytes(7))
    with pytest.raises(DeviceError, match="breaks the protocol"):
        open_device(emulator.url)
