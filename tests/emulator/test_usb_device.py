from __future__ import annotations

import pytest
from phasewire import Emulator
from phasewire.emulator.usb_device import Handshake, Setup, Stall
from phasewire.protocol import Info, Wiring
from phasewire.protocol.replies import decode_wiring

GET_DESCRIPTOR, SET_CONFIGURATION = 6, 9


def test_endpoints_stall_until_configured() -> None:
    usb = Emulator().usb
    assert usb.bulk_out(0x01, bytes(512)) is Handshake.STALL
    assert usb.bulk_in(0x81) is Handshake.STALL
    usb.control(Setup(0, SET_CONFIGURATION, 1, 0, 0))
    assert usb.bulk_out(0x01, bytes(512)) is Handshake.ACK
    assert isinstance(usb.bulk_in(0x81), bytes)
    assert usb.bulk_in(0x81) is Handshake.NAK
    assert usb.bulk_out(0x02, bytes(512)) is Handshake.STALL


@pytest.mark.parametrize(
    "setup",
    [
        Setup(0xC1, 0x77, 0, 0, 64),
        Setup(0x41, 0x77, 0, 0, 0),
        Setup(0x80, GET_DESCRIPTOR, 0x0300 + 9, 0, 255),
        Setup(0x80, GET_DESCRIPTOR, 0x0201, 0, 255),
        Setup(0x80, GET_DESCRIPTOR, 0x0600, 0, 255),
        Setup(0x00, SET_CONFIGURATION, 2, 0, 0),
        Setup(0x01, 11, 1, 0, 0),
    ],
)
def test_unknown_requests_stall(setup: Setup) -> None:
    with pytest.raises(Stall):
        Emulator().usb.control(setup)


@pytest.mark.parametrize(
    "setup", [Setup(0x41, 4, 7, 0, 0), Setup(0x41, 4, 0, 3, 0), Setup(0xC1, 1, 1, 0, 32), Setup(0xC1, 2, 0, 1, 28)]
)
def test_vendor_requests_with_another_value_or_index_stall(setup: Setup) -> None:
    usb = Emulator().usb
    usb.control(Setup(0, SET_CONFIGURATION, 1, 0, 0))
    with pytest.raises(Stall, match="index 0, value 0 unless it takes one"):
        usb.control(setup)


def test_vendor_requests_stall_until_configured() -> None:
    with pytest.raises(Stall, match="needs a configured device"):
        Emulator().usb.control(Setup(0x41, 4, 0, 0, 0))


def test_an_answer_is_cut_to_the_length_asked_for() -> None:
    usb = Emulator().usb
    whole = usb.control(Setup(0x80, GET_DESCRIPTOR, 0x0100, 0, 64))
    assert usb.control(Setup(0x80, GET_DESCRIPTOR, 0x0100, 0, 8)) == whole[:8]


def test_standard_requests_answer() -> None:
    usb = Emulator().usb
    assert usb.control(Setup(0x80, 0, 0, 0, 2)) == b"\x01\x00"
    assert usb.control(Setup(0x80, 8, 0, 0, 1)) == b"\x00"
    usb.control(Setup(0, SET_CONFIGURATION, 1, 0, 0))
    assert usb.control(Setup(0x80, 8, 0, 0, 1)) == b"\x01"
    assert usb.control(Setup(0x81, 10, 0, 0, 1)) == b"\x00"
    assert usb.control(Setup(0x01, 11, 0, 0, 0)) == b""


def test_the_device_tells_its_table_and_its_numbers(scrambled: Wiring) -> None:
    usb = Emulator(table=scrambled).usb
    usb.control(Setup(0, SET_CONFIGURATION, 1, 0, 0))
    assert decode_wiring(usb.control(Setup(0xC1, 3, 0, 0, 640))).channels.tolist() == scrambled.channels.tolist()
    info = Info.decode(usb.control(Setup(0xC1, 1, 0, 0, 64)))
    assert (info.channels, info.columns * info.rows, info.boards * info.processors_per_board) == (320, 320, 10)
