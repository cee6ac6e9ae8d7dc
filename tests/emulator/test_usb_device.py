from __future__ import annotations

import struct

import pytest
from phasewire import Emulator
from phasewire.emulator.door import Handshake, Stall
from phasewire.emulator.usb_device import UsbDevice
from phasewire.protocol import Info, Wiring
from phasewire.protocol.replies import decode_wiring
from phasewire.protocol.requests import Setup

GET_DESCRIPTOR, SET_CONFIGURATION = 6, 9


def configured() -> UsbDevice:
    usb = Emulator().usb
    usb.control(Setup(0, SET_CONFIGURATION, 1, 0, 0))
    return usb


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
        Setup(0x80, GET_DESCRIPTOR, 0x0300 + 9, 0x0409, 255),
        Setup(0x80, GET_DESCRIPTOR, 0x0301, 0x0407, 255),  # in German
        Setup(0x80, GET_DESCRIPTOR, 0x0201, 0, 255),
        Setup(0x80, GET_DESCRIPTOR, 0x0A00, 0, 255),
        Setup(0x00, SET_CONFIGURATION, 2, 0, 0),
        Setup(0x00, 3, 1, 0, 0),  # remote wake-up
        Setup(0x01, 11, 1, 0, 0),
        Setup(0x01, 11, 0, 4, 0),
        Setup(0x81, 0, 0, 4, 2),
        Setup(0x81, 10, 0, 4, 1),
        Setup(0x02, 3, 0, 0x84, 0),
        Setup(0x02, 3, 1, 0x81, 0),
        Setup(0x82, 0, 0, 0x84, 2),
        Setup(0xC0, 0x20, 0, 8, 4),  # alternate enumeration, which is not offered
        Setup(0xC0, 0x20, 1, 7, 4),
        Setup(0x21, 0, 1000, 3, 0),  # DETACH
        Setup(0xA1, 3, 0, 0, 6),  # GETSTATUS, to the wrong interface
        Setup(0x21, 0x23, 0, 1, 0),  # SEND_BREAK
    ],
)
def test_unknown_requests_stall(setup: Setup) -> None:
    usb = configured()
    with pytest.raises(Stall):
        usb.control(setup)


@pytest.mark.parametrize(
    "setup",
    [
        Setup(0x81, 0, 0, 0, 2),
        Setup(0x81, 10, 0, 0, 1),
        Setup(0x01, 11, 0, 0, 0),
        Setup(0x82, 0, 0, 0x81, 2),
        Setup(0x02, 1, 0, 0x81, 0),
        Setup(0xA1, 0x21, 0, 1, 7),
        Setup(0xA1, 5, 0, 3, 1),
    ],
)
def test_interfaces_and_endpoints_are_there_once_configured(setup: Setup) -> None:
    usb = Emulator().usb
    with pytest.raises(Stall):
        usb.control(setup)
    usb.control(Setup(0, SET_CONFIGURATION, 1, 0, 0))
    assert len(usb.control(setup)) == setup.length


def test_windows_finds_its_descriptors_before_it_configures() -> None:
    """In two steps: the BOS says where to ask and how much, D8DD60DF-4589-4CC7-9CD2-659D9E648A9F says for what."""
    usb = Emulator().usb
    bos = usb.control(Setup(0x80, GET_DESCRIPTOR, 0x0F00, 0, 255))
    place = bos.index(bytes.fromhex("df60ddd8 8945 c74c 9cd2 659d9e648a9f")) + 16
    version, size, vendor_code, _ = struct.unpack_from("<IHBB", bos, place)
    answer = usb.control(Setup(0xC0, vendor_code, 0, 7, size))
    assert len(answer) == size
    assert answer[:10] == struct.pack("<HHIH", 10, 0, version, size)
    assert answer.count(b"WINUSB") == 2


def test_the_console_keeps_its_line_coding() -> None:
    usb = configured()
    assert usb.control(Setup(0xA1, 0x21, 0, 1, 7)) == bytes([0x00, 0xC2, 0x01, 0x00, 0, 0, 8])  # 115 200, 8N1
    wanted = bytes([0x80, 0x25, 0, 0, 2, 2, 7])
    assert usb.control(Setup(0x21, 0x20, 0, 1, 7), wanted) == b""
    assert usb.control(Setup(0xA1, 0x21, 0, 1, 7)) == wanted
    assert usb.control(Setup(0x21, 0x22, 3, 1, 0)) == b""
    with pytest.raises(Stall):
        usb.control(Setup(0x21, 0x20, 0, 1, 6), wanted[:6])
    assert usb.control(Setup(0xA1, 0x21, 0, 1, 7)) == wanted


def test_the_console_has_nothing_to_say_and_takes_nothing() -> None:
    usb = configured()
    assert usb.bulk_in(0x82) is usb.bulk_in(0x83) is usb.bulk_out(0x03, b"help\r") is Handshake.NAK


def test_dfu_idles_at_run_time() -> None:
    """DFU 1.1, chapter 6.1.2: status OK 0, poll time-out 0, state appIDLE 0, no string."""
    usb = configured()
    assert usb.control(Setup(0xA1, 3, 0, 3, 6)) == bytes(6)
    assert usb.control(Setup(0xA1, 5, 0, 3, 1)) == bytes(1)


def test_an_empty_packet_is_no_block() -> None:
    usb = configured()
    assert usb.bulk_out(0x01, b"") is Handshake.ACK
    assert usb.bulk_in(0x81) is Handshake.NAK
    assert usb.bulk_out(0x01, b"P") is Handshake.ACK
    assert isinstance(usb.bulk_in(0x81), bytes)


def test_a_host_halts_an_endpoint_and_ends_the_halt() -> None:
    usb = configured()
    usb.bulk_out(0x01, bytes(512))
    for endpoint in (0x01, 0x81):
        usb.control(Setup(0x02, 3, 0, endpoint, 0))
        assert usb.control(Setup(0x82, 0, 0, endpoint, 2)) == b"\x01\x00"
    assert usb.bulk_out(0x01, bytes(512)) is usb.bulk_in(0x81) is Handshake.STALL
    assert usb.bulk_in(0x83) is Handshake.NAK
    usb.control(Setup(0x02, 1, 0, 0x81, 0))
    assert usb.control(Setup(0x82, 0, 0, 0x81, 2)) == b"\x00\x00"
    assert isinstance(usb.bulk_in(0x81), bytes)  # the acknowledgement was kept
    assert usb.bulk_out(0x01, bytes(512)) is Handshake.STALL


@pytest.mark.parametrize("ending", [Setup(0, SET_CONFIGURATION, 1, 0, 0), Setup(0x01, 11, 0, 0, 0), None])
def test_a_new_session_ends_halts_and_drops_acknowledgements(ending: Setup | None) -> None:
    usb = configured()
    usb.bulk_out(0x01, bytes(512))
    usb.control(Setup(0x02, 3, 0, 0x81, 0))
    if ending is None:
        usb.reset()
        usb.control(Setup(0, SET_CONFIGURATION, 1, 0, 0))
    else:
        usb.control(ending)
    assert usb.bulk_in(0x81) is Handshake.NAK


def test_setting_another_interface_leaves_the_array_alone() -> None:
    usb = configured()
    usb.bulk_out(0x01, bytes(512))
    for endpoint in (0x81, 0x83):
        usb.control(Setup(0x02, 3, 0, endpoint, 0))
    usb.control(Setup(0x01, 11, 0, 2, 0))
    assert usb.bulk_in(0x83) is Handshake.NAK
    assert usb.bulk_in(0x81) is Handshake.STALL
    usb.control(Setup(0x02, 1, 0, 0x81, 0))
    assert isinstance(usb.bulk_in(0x81), bytes)


@pytest.mark.parametrize(
    "setup", [Setup(0x41, 4, 7, 0, 0), Setup(0x41, 4, 0, 3, 0), Setup(0xC1, 1, 1, 0, 32), Setup(0xC1, 2, 0, 1, 28)]
)
def test_vendor_requests_with_another_value_or_index_stall(setup: Setup) -> None:
    usb = Emulator().usb
    usb.control(Setup(0, SET_CONFIGURATION, 1, 0, 0))
    with pytest.raises(Stall, match="has index 0 and value 0 to 0, not"):
        usb.control(setup)


def test_vendor_requests_with_data_stall() -> None:
    usb = Emulator().usb
    usb.control(Setup(0, SET_CONFIGURATION, 1, 0, 0))
    with pytest.raises(Stall, match="takes data"):
        usb.control(Setup(0x41, 4, 0, 0, 3), b"abc")


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
    assert usb.control(Setup(0x81, 0, 0, 3, 2)) == b"\x00\x00"
    assert usb.control(Setup(0x82, 0, 0, 0x00, 2)) == usb.control(Setup(0x82, 0, 0, 0x80, 2)) == b"\x00\x00"
    assert usb.control(Setup(0x01, 11, 0, 0, 0)) == b""


def test_the_device_tells_its_table_and_its_numbers(scrambled: Wiring) -> None:
    usb = Emulator(table=scrambled).usb
    usb.control(Setup(0, SET_CONFIGURATION, 1, 0, 0))
    assert decode_wiring(usb.control(Setup(0xC1, 3, 0, 0, 640))).channels.tolist() == scrambled.channels.tolist()
    info = Info.decode(usb.control(Setup(0xC1, 1, 0, 0, 64)))
    assert (info.channels, info.columns * info.rows, info.boards * info.processors_per_board) == (320, 320, 10)
