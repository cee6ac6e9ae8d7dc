"""What USB 2.0, chapter 9, and chapter USB of the specification ask of any mode of the device."""

from __future__ import annotations

import struct

import pytest
from phasewire.emulator.door import Handshake, Stall
from phasewire.protocol.enumeration import FULL_SPEED, HIGH_SPEED, Speed, dfu_mode, run_time
from phasewire.protocol.requests import Setup

from tests.emulator.usb_bench import SET_CONFIGURATION, Bench, ack, configured, status

UNCONFIGURE = Setup(0x00, 9, 0, 0, 0)
GET_DEVICE = Setup(0x80, 6, 0x0100, 0, 18)
DETACH = Setup(0x21, 0, 1000, 3, 0)
GETSTATUS = Setup(0xA1, 3, 0, 3, 6)
GETSTATE = Setup(0xA1, 5, 0, 3, 1)


def stalls(bench: Bench, setup: Setup, data: bytes = b"") -> bool:
    try:
        bench.usb.control(setup, data)
    except Stall:
        return True
    return False


# Standard requests


def test_endpoints_stall_until_configured() -> None:
    bench = Bench()
    outs, ins = (0x01, 0x03), (0x81, 0x82, 0x83)
    for configure in (False, True):
        if configure:
            bench.usb.control(SET_CONFIGURATION)
        assert {bench.usb.bulk_out(endpoint, b"") for endpoint in outs} == {
            Handshake.ACK if configure else Handshake.STALL
        }
        assert {bench.usb.bulk_in(endpoint) for endpoint in ins} == {Handshake.NAK if configure else Handshake.STALL}
        for endpoint in (0x00, 0x02, 0x81):
            assert bench.usb.bulk_out(endpoint, b"") is Handshake.STALL
        for endpoint in (0x80, 0x01, 0x84):
            assert bench.usb.bulk_in(endpoint) is Handshake.STALL


@pytest.mark.parametrize(
    "setup",
    [
        Setup(0x80, 6, 0x0300 + 9, 0x0409, 255),
        Setup(0x80, 6, 0x0301, 0x0407, 255),  # in German
        Setup(0x80, 6, 0x0201, 0, 255),
        Setup(0x80, 6, 0x0A00, 0, 255),
        Setup(0x00, 7, 0x0100, 0, 18),  # SET_DESCRIPTOR
        Setup(0x82, 12, 0, 0x81, 2),  # SYNCH_FRAME
        Setup(0x00, 9, 2, 0, 0),
        Setup(0x00, 9, 1, 1, 0),
        Setup(0x00, 9, 1, 0, 3),  # with data
        Setup(0x00, 5, 128, 0, 0),
        Setup(0x00, 5, 1, 1, 0),
        Setup(0x80, 0, 0, 0xF000, 1),  # the status of On-The-Go
        Setup(0x80, 8, 1, 0, 1),
        Setup(0x00, 3, 1, 0, 0),  # remote wake-up
        Setup(0x00, 1, 1, 0, 0),
        Setup(0x00, 3, 2, 0x0000, 0),  # tests 0 and 5, and one with a port
        Setup(0x00, 3, 2, 0x0500, 0),
        Setup(0x00, 3, 2, 0x0401, 0),
        Setup(0x00, 1, 2, 0, 0),
        Setup(0x01, 11, 1, 0, 0),
        Setup(0x01, 11, 0, 4, 0),
        Setup(0x81, 0, 0, 4, 2),
        Setup(0x81, 0, 1, 0, 2),
        Setup(0x81, 10, 0, 4, 1),
        Setup(0x02, 3, 0, 0x84, 0),
        Setup(0x02, 3, 1, 0x81, 0),
        Setup(0x02, 3, 0, 0x00, 0),
        Setup(0x82, 0, 0, 0x84, 2),
        Setup(0xC0, 0x20, 0, 8, 4),  # alternate enumeration, which is not offered
        Setup(0xC0, 0x20, 1, 7, 4),
        Setup(0xC0, 1, 0, 0, 64),  # vendor requests are for the interface
        Setup(0xC1, 0x77, 0, 0, 64),
        Setup(0xC1, 1, 0, 1, 64),
        Setup(0xC1, 1, 0, 3, 64),
        Setup(0xC1, 1, 0, 4, 64),
        Setup(0xA1, 3, 0, 0, 6),  # GETSTATUS, to the wrong interface
        Setup(0xA1, 0x21, 0, 2, 7),  # GET_LINE_CODING, to the data interface
        Setup(0x21, 0x23, 0, 1, 0),  # SEND_BREAK
        Setup(0x23, 3, 0, 1, 0),  # to a port, as if it were a hub
    ],
)
def test_what_it_does_not_know_stalls(setup: Setup) -> None:
    """Clauses USB-004 and USB-014."""
    bench = configured()
    assert stalls(bench, setup)
    assert bench.usb.attached
    assert bench.usb.configuration == 1
    assert bench.controller.told in ([], ["request 119"])


@pytest.mark.parametrize(
    "setup",
    [
        Setup(0x81, 0, 0, 0, 2),
        Setup(0x81, 10, 0, 0, 1),
        Setup(0x01, 11, 0, 0, 0),
        Setup(0x82, 0, 0, 0x81, 2),
        Setup(0x02, 1, 0, 0x81, 0),
        Setup(0x02, 3, 0, 0x01, 0),
        Setup(0xA1, 0x21, 0, 1, 7),
        Setup(0xA1, 5, 0, 3, 1),
        Setup(0xC1, 1, 0, 0, 64),
        Setup(0x41, 4, 0, 0, 0),
    ],
)
def test_interfaces_and_endpoints_are_there_once_configured(setup: Setup) -> None:
    bench = Bench()
    assert stalls(bench, setup)
    assert not bench.controller.told
    bench.usb.control(SET_CONFIGURATION)
    assert len(bench.usb.control(setup)) == setup.length
    bench.usb.control(UNCONFIGURE)
    assert stalls(bench, setup)


def test_standard_requests_answer() -> None:
    usb = Bench().usb
    assert usb.control(Setup(0x80, 0, 0, 0, 2)) == b"\x01\x00"
    assert usb.control(Setup(0x80, 8, 0, 0, 1)) == b"\x00"
    usb.control(SET_CONFIGURATION)
    assert usb.control(Setup(0x80, 8, 0, 0, 1)) == b"\x01"
    assert usb.control(Setup(0x81, 10, 0, 0, 1)) == b"\x00"
    assert usb.control(Setup(0x81, 0, 0, 3, 2)) == b"\x00\x00"
    assert usb.control(Setup(0x82, 0, 0, 0x00, 2)) == usb.control(Setup(0x82, 0, 0, 0x80, 2)) == b"\x00\x00"
    assert usb.control(Setup(0x01, 11, 0, 0, 0)) == b""


def test_the_address_is_kept_until_a_reset() -> None:
    usb = configured().usb
    usb.control(Setup(0x00, 5, 127, 0, 0))
    assert usb.address == 127
    usb.reset()
    assert (usb.address, usb.configuration) == (0, 0)


def test_an_answer_is_cut_to_the_length_asked_for() -> None:
    usb = Bench().usb
    whole = usb.control(Setup(0x80, 6, 0x0100, 0, 64))
    assert usb.control(Setup(0x80, 6, 0x0100, 0, 8)) == whole[:8]
    assert usb.control(Setup(0x80, 6, 0x0100, 0, 0)) == b""


@pytest.mark.parametrize("speed", [HIGH_SPEED, FULL_SPEED])
def test_descriptors_are_those_of_the_speed_and_the_version(speed: Speed) -> None:
    bench = Bench(speed)
    assert bench.usb.enumeration == run_time((1, 2, 3), bench.usb.enumeration.strings[2], "BENCH-1", speed)
    assert bench.usb.control(GET_DEVICE)[12:14] == b"\x23\x01"


def test_windows_finds_its_descriptors_before_it_configures() -> None:
    """In two steps: the BOS says where to ask and how much, D8DD60DF-4589-4CC7-9CD2-659D9E648A9F says for what."""
    usb = Bench().usb
    bos = usb.control(Setup(0x80, 6, 0x0F00, 0, 255))
    place = bos.index(bytes.fromhex("df60ddd8 8945 c74c 9cd2 659d9e648a9f")) + 16
    version, size, vendor_code, _ = struct.unpack_from("<IHBB", bos, place)
    answer = usb.control(Setup(0xC0, vendor_code, 0, 7, size))
    assert len(answer) == size
    assert answer[:10] == struct.pack("<HHIH", 10, 0, version, size)
    assert answer.count(b"WINUSB") == 2


@pytest.mark.parametrize("speed", [HIGH_SPEED, FULL_SPEED])
def test_only_a_high_speed_device_has_test_modes_and_it_does_not_come_back(speed: Speed) -> None:
    """USB 2.0, 9.4.9: it no longer responds, until its power is cycled."""
    bench = configured(speed)
    test_packet = Setup(0x00, 3, 2, 0x0400, 0)
    assert stalls(bench, test_packet) == (speed == FULL_SPEED)
    assert bench.usb.attached == (speed == FULL_SPEED)
    bench.usb.reset()
    bench.run_ms(1000)
    assert bench.usb.attached == (speed == FULL_SPEED)


# Halts


def test_a_host_halts_an_endpoint_and_ends_the_halt() -> None:
    """Clauses USB-015 and USB-025."""
    bench = configured()
    usb = bench.usb
    usb.bulk_out(0x01, bytes(512))
    for endpoint in (0x01, 0x81, 0x83):
        usb.control(Setup(0x02, 3, 0, endpoint, 0))
        assert usb.control(Setup(0x82, 0, 0, endpoint, 2)) == b"\x01\x00"
    assert usb.bulk_out(0x01, bytes(512)) is usb.bulk_in(0x81) is usb.bulk_in(0x83) is Handshake.STALL
    assert usb.bulk_in(0x82) is Handshake.NAK
    usb.control(Setup(0x02, 1, 0, 0x81, 0))
    assert usb.control(Setup(0x82, 0, 0, 0x81, 2)) == b"\x00\x00"
    assert usb.bulk_in(0x81) == ack(0)  # it was kept
    assert usb.bulk_out(0x01, bytes(512)) is usb.bulk_in(0x83) is Handshake.STALL
    assert bench.controller.told == []


@pytest.mark.parametrize("interface", range(4))
def test_set_interface_ends_the_halts_of_its_endpoints(interface: int) -> None:
    """Clause USB-016."""
    usb = configured().usb
    of_interface = {0: {0x01, 0x81}, 1: {0x82}, 2: {0x03, 0x83}, 3: set[int]()}[interface]
    for endpoint in (0x01, 0x81, 0x82, 0x03, 0x83):
        usb.control(Setup(0x02, 3, 0, endpoint, 0))
    usb.control(Setup(0x01, 11, 0, interface, 0))
    for endpoint in (0x01, 0x81, 0x82, 0x03, 0x83):
        assert usb.control(Setup(0x82, 0, 0, endpoint, 2))[0] == (endpoint not in of_interface)


@pytest.mark.parametrize("event", ["reset", "configure", "unplug"])
def test_a_new_configuration_has_no_halts(event: str) -> None:
    usb = configured().usb
    usb.control(Setup(0x02, 3, 0, 0x81, 0))
    if event == "reset":
        usb.reset()
    elif event == "unplug":
        usb.unplug()
        usb.plug()
    usb.control(SET_CONFIGURATION)
    assert usb.bulk_in(0x81) is Handshake.NAK


@pytest.mark.parametrize(("speed", "largest"), [(HIGH_SPEED, 512), (FULL_SPEED, 64)])
def test_a_packet_that_no_bus_can_carry_is_refused(speed: Speed, largest: int) -> None:
    usb = configured(speed).usb
    for endpoint in (0x01, 0x03):
        assert usb.bulk_out(endpoint, bytes(largest)) is Handshake.ACK
        with pytest.raises(ValueError, match=rf"endpoint 0x0{endpoint} has at most {largest} bytes, not {largest + 1}"):
            usb.bulk_out(endpoint, bytes(largest + 1))


# Attachment


def test_it_shows_itself_with_voltage_and_firmware_only() -> None:
    """Clause USB-022; the generation tells a host that it has to enumerate anew."""
    bench = Bench()
    usb = bench.usb
    assert (usb.attached, usb.generation) == (True, 1)
    usb.unplug()
    assert (usb.attached, usb.generation) == (False, 1)
    usb.disconnect()
    usb.plug()
    assert (usb.attached, usb.generation) == (False, 1)
    usb.connect(bench.controller, bench.line, (1, 2, 3))
    assert (usb.attached, usb.generation) == (True, 2)
    usb.plug()  # where it is already
    assert usb.generation == 2
    usb.unplug()
    usb.connect(bench.controller, bench.line, (1, 2, 3))
    assert (usb.attached, usb.generation) == (False, 2)
    usb.plug()
    assert (usb.attached, usb.generation) == (True, 3)


def test_a_restart_forgets_the_session() -> None:
    bench = configured()
    bench.usb.control(Setup(0x00, 5, 9, 0, 0))
    bench.usb.bulk_out(0x01, bytes(512))
    bench.usb.disconnect()
    assert not bench.usb.attached
    bench.usb.connect(bench.controller, bench.line, (1, 2, 3))
    assert (bench.usb.address, bench.usb.configuration) == (0, 0)
    bench.usb.control(SET_CONFIGURATION)
    assert bench.usb.bulk_in(0x81) is Handshake.NAK


# Suspend, resume, unplug


def test_suspend_and_resume_keep_the_configuration() -> None:
    """Clause USB-020: configured as before, and it keeps the records that wait."""
    bench = configured()
    bench.usb.bulk_out(0x01, bytes(512))
    bench.usb.suspend()
    bench.usb.suspend()
    assert bench.usb.suspended
    bench.door.notify(status(0))
    bench.usb.resume()
    bench.usb.resume()
    assert not bench.usb.suspended
    assert bench.controller.told == ["suspend", "resume"]
    assert bench.usb.configuration == 1
    assert bench.usb.bulk_in(0x81) == ack(0) + status(0)
    assert "hang up" not in bench.line.told


def test_a_device_that_no_bus_configured_is_not_suspended() -> None:
    """Clause STA-006."""
    bench = Bench()
    bench.usb.suspend()
    bench.usb.resume()
    bench.usb.unplug()
    bench.usb.plug()
    assert bench.controller.told == []


def test_loss_of_voltage_suspends_resumes_and_takes_the_configuration() -> None:
    """Clause STA-006; not the event BUS_RESET, which would end what plays unattended (clause USB-020)."""
    bench = configured()
    bench.usb.bulk_out(0x01, bytes(512))
    bench.usb.unplug()
    bench.usb.unplug()
    assert bench.controller.told == ["suspend", "resume"]
    assert bench.line.told == ["hang up"]
    assert bench.usb.configuration == 0
    bench.door.notify(status(0))
    bench.usb.plug()
    bench.usb.suspend()  # another bus, which has not configured it
    bench.usb.resume()
    assert bench.controller.told == ["suspend", "resume"]
    bench.usb.control(SET_CONFIGURATION)
    assert bench.usb.bulk_in(0x81) is Handshake.NAK
    bench.usb.suspend()
    assert bench.controller.told == ["suspend", "resume", "new session", "host arrived", "suspend"]


def test_a_suspended_bus_that_loses_its_voltage_or_is_reset_is_suspended_no_more() -> None:
    bench = configured()
    bench.usb.suspend()
    bench.usb.unplug()
    bench.usb.plug()
    assert not bench.usb.suspended
    assert bench.controller.told[-1] == "resume"
    bench.usb.control(SET_CONFIGURATION)
    bench.usb.suspend()
    bench.usb.reset()
    assert not bench.usb.suspended
    assert bench.controller.told[-3:] == ["suspend", "resume", "new session"]


# To DFU mode and back


def test_detach_leads_to_dfu_mode() -> None:
    """Clauses DFU-002 and USB-024: off the bus 10 to 1000 ms after DETACH, for at least 10 ms."""
    bench = configured()
    usb = bench.usb
    assert (usb.control(GETSTATUS), usb.control(GETSTATE)) == (bytes(6), bytes(1))
    assert usb.control(DETACH) == b""
    assert bench.controller.told == ["detach"]
    assert (usb.control(GETSTATUS), usb.control(GETSTATE)) == (bytes([0, 0, 0, 0, 1, 0]), bytes([1]))
    bench.run_ms(10)
    assert usb.attached
    left = 10
    while usb.attached:
        bench.run_ms(1)
        left += 1
    assert left <= 1000
    bench.run_ms(9)
    assert (usb.attached, usb.generation) == (False, 1)
    bench.run_ms(1000)
    assert (usb.attached, usb.generation) == (True, 2)
    assert (usb.address, usb.configuration) == (0, 0)
    assert usb.enumeration == dfu_mode((1, 2, 3), usb.enumeration.strings[2], "BENCH-1")
    assert usb.control(GET_DEVICE)[10:12] == b"\x02\x00"


def in_dfu_mode() -> Bench:
    bench = configured()
    bench.usb.control(DETACH)
    bench.run_ms(1010)
    assert bench.usb.attached
    return bench


@pytest.mark.parametrize(
    "setup",
    [
        Setup(0x21, 1, 0, 3, 0),
        Setup(0xA1, 2, 0, 3, 64),
        Setup(0x21, 4, 0, 3, 0),
        Setup(0x21, 6, 0, 3, 0),
        Setup(0xA1, 0, 0, 3, 0),
        DETACH,
    ],
)
def test_what_does_not_belong_to_run_time_stalls_and_calls_nothing_off(setup: Setup) -> None:
    """Clause DFU-006."""
    bench = configured()
    bench.usb.control(DETACH)
    bench.controller.can_detach = False  # no transition from DFU
    assert stalls(bench, setup)
    assert bench.usb.control(GETSTATE) == bytes(1)
    bench.run_ms(1010)
    assert bench.usb.control(GET_DEVICE)[10:12] == b"\x02\x00"


def test_detach_stalls_where_the_state_forbids_it() -> None:
    """Clause STA-005."""
    bench = configured()
    bench.controller.can_detach = False
    assert stalls(bench, DETACH)
    with pytest.raises(Stall, match="cannot be detached in this state"):
        bench.usb.detach(bench.door)
    bench.run_ms(2000)
    assert (bench.usb.generation, bench.usb.control(GETSTATE)) == (1, bytes(1))


def test_the_console_detaches_as_the_request_does() -> None:
    bench = configured()
    bench.usb.detach(bench.door)
    assert bench.usb.control(GETSTATE) == bytes([1])
    bench.run_ms(1010)
    assert bench.usb.generation == 2
    with pytest.raises(Stall, match="only a device in run-time mode"):
        bench.usb.detach(bench.door)


def test_a_bus_reset_hastens_a_detach() -> None:
    """Clause DFU-002."""
    bench = configured()
    bench.usb.control(DETACH)
    bench.usb.reset()
    assert not bench.usb.attached
    bench.run_ms(9)
    assert not bench.usb.attached
    bench.run_ms(2000)
    assert bench.usb.generation == 2
    assert bench.usb.control(GET_DEVICE)[10:12] == b"\x02\x00"


def test_a_bus_reset_hastens_a_detach_that_nothing_called_off() -> None:
    bench = configured()
    bench.usb.control(DETACH)
    bench.controller.can_detach = False
    assert stalls(bench, DETACH)
    bench.usb.reset()
    assert not bench.usb.attached


@pytest.mark.parametrize("wait_ms", [0, 25])
def test_a_restart_calls_a_detach_off(wait_ms: int) -> None:
    bench = configured()
    bench.usb.control(DETACH)
    bench.run_ms(wait_ms)
    bench.usb.connect(bench.controller, bench.line, (1, 2, 3))
    bench.run_ms(2000)
    assert bench.usb.control(GET_DEVICE)[10:12] == b"\x01\x00"


def test_a_device_that_is_unplugged_meanwhile_comes_back_in_dfu_mode() -> None:
    bench = configured()
    bench.usb.control(DETACH)
    bench.usb.unplug()
    bench.run_ms(2000)
    assert (bench.usb.attached, bench.usb.generation) == (False, 1)
    bench.usb.plug()
    assert (bench.usb.attached, bench.usb.generation) == (True, 2)
    assert bench.usb.control(GET_DEVICE)[10:12] == b"\x02\x00"


def test_dfu_mode_has_one_interface_and_no_endpoints() -> None:
    """Clause USB-013."""
    bench = in_dfu_mode()
    assert stalls(bench, Setup(0xA1, 5, 0, 0, 1))
    bench.usb.control(SET_CONFIGURATION)
    assert bench.usb.control(Setup(0xA1, 5, 0, 0, 1)) == b"\x02"
    assert bench.upgrade.requests == [Setup(0xA1, 5, 0, 0, 1)]
    assert bench.usb.control(Setup(0x81, 10, 0, 0, 1)) == b"\x00"
    assert stalls(bench, GETSTATE)
    assert stalls(bench, Setup(0xC1, 1, 0, 0, 64))
    assert bench.usb.bulk_out(0x01, b"") is bench.usb.bulk_in(0x81) is Handshake.STALL
    assert bench.controller.told == ["detach"]
    bench.usb.suspend()
    bench.usb.resume()
    bench.usb.unplug()
    bench.usb.plug()
    assert bench.usb.attached


def test_resets_count_once_dfu_mode_was_configured() -> None:
    """Clause DFU-015."""
    bench = in_dfu_mode()
    for _ in range(3):
        bench.usb.reset()
    bench.usb.control(UNCONFIGURE)
    bench.usb.reset()
    assert (bench.restarts, bench.usb.attached) == (0, True)
    bench.usb.control(SET_CONFIGURATION)
    bench.usb.control(UNCONFIGURE)
    bench.usb.reset()
    assert (bench.restarts, bench.usb.attached) == (1, False)
    bench.usb.connect(bench.controller, bench.line, (1, 3, 0))
    assert bench.usb.generation == 3
    assert bench.usb.control(GET_DEVICE)[10:14] == bytes.fromhex("01003001")
