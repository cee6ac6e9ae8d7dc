from __future__ import annotations

import re
from itertools import product

import pytest
from phasewire.protocol.codes import (
    CLASS_REQUEST_TYPE_IN,
    CLASS_REQUEST_TYPE_OUT,
    DFU_ATTRIBUTES,
    DFU_DETACH_TIMEOUT_MS,
    DFU_TRANSFER_BYTES,
    DFU_VERSION,
    DfuRequest,
    DfuState,
    DfuStatus,
)
from phasewire.protocol.dfu import (
    TRANSITIONS,
    DfuEvent,
    DfuReply,
)

# The tables of DFU 1.1, appendix A.2, for a device that can download and upload, tolerates manifestation, detaches by
# itself and is never corrupt. One entry for a row of a table: event, action, next state. "stall" is a STALL of the
# control pipe; "any other" is every other request of the class. A.2.9 does not occur in a tolerant device.
STANDARD = """
appIDLE: DETACH, ok, appDETACH; GETSTATUS, ok, appIDLE; GETSTATE, ok, appIDLE; any other, stall, appIDLE
appIDLE: reset, ok, appIDLE
appDETACH: GETSTATUS, ok, appDETACH; GETSTATE, ok, appDETACH; any other, stall, appIDLE; reset, ok, dfuIDLE
appDETACH: detaches by itself, ok, dfuIDLE
dfuIDLE: DNLOAD with data, ok, dfuDNLOAD-SYNC; UPLOAD, ok, dfuUPLOAD-IDLE; UPLOAD short, ok, dfuUPLOAD-IDLE
dfuIDLE: ABORT, ok, dfuIDLE; GETSTATUS, ok, dfuIDLE; GETSTATE, ok, dfuIDLE; any other, stall, dfuERROR
dfuDNLOAD-SYNC: GETSTATUS in progress, ok, dfuDNBUSY; GETSTATUS, ok, dfuDNLOAD-IDLE; GETSTATE, ok, dfuDNLOAD-SYNC
dfuDNLOAD-SYNC: any other, stall, dfuERROR
dfuDNBUSY: poll timeout, ok, dfuDNLOAD-SYNC; any other, stall, dfuERROR
dfuDNLOAD-IDLE: DNLOAD with data, ok, dfuDNLOAD-SYNC; DNLOAD empty and agreed, ok, dfuMANIFEST-SYNC
dfuDNLOAD-IDLE: ABORT, ok, dfuIDLE; GETSTATUS, ok, dfuDNLOAD-IDLE; GETSTATE, ok, dfuDNLOAD-IDLE
dfuDNLOAD-IDLE: any other, stall, dfuERROR
dfuMANIFEST-SYNC: GETSTATUS in progress, ok, dfuMANIFEST; GETSTATUS, ok, dfuIDLE; GETSTATE, ok, dfuMANIFEST-SYNC
dfuMANIFEST-SYNC: any other, stall, dfuERROR
dfuMANIFEST: poll timeout, ok, dfuMANIFEST-SYNC; any other, stall, dfuERROR
dfuUPLOAD-IDLE: UPLOAD, ok, dfuUPLOAD-IDLE; UPLOAD short, ok, dfuIDLE; ABORT, ok, dfuIDLE
dfuUPLOAD-IDLE: GETSTATUS, ok, dfuUPLOAD-IDLE; GETSTATE, ok, dfuUPLOAD-IDLE; any other, stall, dfuERROR
dfuERROR: GETSTATUS, ok, dfuERROR; GETSTATE, ok, dfuERROR; CLRSTATUS, ok, dfuIDLE; any other, stall, dfuERROR
"""
STATES = (
    *("appIDLE", "appDETACH", "dfuIDLE", "dfuDNLOAD-SYNC", "dfuDNBUSY", "dfuDNLOAD-IDLE", "dfuMANIFEST-SYNC"),
    *("dfuMANIFEST", "dfuMANIFEST-WAIT-RESET", "dfuUPLOAD-IDLE", "dfuERROR"),
)
STATUSES = (
    *("OK", "errTARGET", "errFILE", "errWRITE", "errERASE", "errCHECK_ERASED", "errPROG", "errVERIFY", "errADDRESS"),
    *("errNOTDONE", "errFIRMWARE", "errVENDOR", "errUSBR", "errPOR", "errUNKNOWN", "errSTALLEDPKT"),
)
EVENTS = {
    "DETACH": DfuEvent.DETACH,
    "DNLOAD with data": DfuEvent.DNLOAD,
    "DNLOAD empty and agreed": DfuEvent.DNLOAD_END,
    "UPLOAD": DfuEvent.UPLOAD,
    "UPLOAD short": DfuEvent.UPLOAD_END,
    "GETSTATUS": DfuEvent.GETSTATUS,
    "GETSTATUS in progress": DfuEvent.GETSTATUS_BUSY,
    "CLRSTATUS": DfuEvent.CLRSTATUS,
    "GETSTATE": DfuEvent.GETSTATE,
    "ABORT": DfuEvent.ABORT,
    "unknown": DfuEvent.REFUSED,
    "poll timeout": DfuEvent.POLL_TIMEOUT,
    "detaches by itself": DfuEvent.REATTACHED,
    "reset": DfuEvent.BUS_RESET,
}
HAPPENINGS = {"poll timeout", "detaches by itself", "reset"}


def standard() -> dict[tuple[str, str], tuple[str, str]]:
    rows: dict[tuple[str, str], tuple[str, str]] = {}
    for line in STANDARD.strip().splitlines():
        state, entries = line.split(": ")
        for entry in entries.split("; "):
            event, action, following = entry.split(", ")
            rows[state, event] = (action, following)
    for state in {state for state, _ in rows}:
        other = rows.pop((state, "any other"))
        for event in EVENTS.keys() - HAPPENINGS:
            # If the tables have no row for a busy device, it answers as any other.
            plain = rows.get((state, "GETSTATUS"), other) if event == "GETSTATUS in progress" else other
            rows.setdefault((state, event), plain)
        if state.startswith("dfu"):
            rows[state, "reset"] = ("ok", "appIDLE")
    return rows


def test_transitions_are_those_of_the_standard() -> None:
    expected = standard()
    assert len(expected) == 10 * (11 + 1) + 3
    for (state, event), (action, following) in expected.items():
        step = TRANSITIONS[DfuState(STATES.index(state)), EVENTS[event]]
        assert (step.stalls, STATES[step.state]) == (action == "stall", following), (state, event)


def test_every_state_has_an_answer_to_every_event() -> None:
    assert set(TRANSITIONS) == set(product(DfuState, DfuEvent))


# Names and numbers


def test_the_names_are_those_of_the_standard() -> None:
    plain = [re.sub("^(dfu(?!IDLE|ERROR)|err)", "", name).upper().replace("-", "_") for name in STATES]
    renamed = {"APPIDLE": "APP_IDLE", "APPDETACH": "APP_DETACH", "DFUIDLE": "DFU_IDLE", "DFUERROR": "ERROR"}
    assert [state.name for state in DfuState] == [renamed.get(name, name) for name in plain]
    assert [status.name for status in DfuStatus] == [name.removeprefix("err") for name in STATUSES]
    requests = ["DETACH", "DNLOAD", "UPLOAD", "GETSTATUS", "CLRSTATUS", "GETSTATE", "ABORT"]
    assert [request.name for request in DfuRequest] == requests


def test_the_numbers_of_the_functional_descriptor() -> None:
    """Clause DFU-001; the request types are those of DFU 1.1, table 3.2."""
    assert (DFU_VERSION, DFU_TRANSFER_BYTES, DFU_DETACH_TIMEOUT_MS, DFU_ATTRIBUTES) == (0x0110, 2048, 1000, 0b1111)
    assert (CLASS_REQUEST_TYPE_OUT, CLASS_REQUEST_TYPE_IN) == (0b00100001, 0b10100001)


# Time and blocks


@pytest.mark.parametrize("poll_ms", [-1, 2**24])
def test_a_reply_that_does_not_fit_is_a_wrong_argument(poll_ms: int) -> None:
    with pytest.raises(ValueError, match="poll_ms"):
        DfuReply(DfuStatus.OK, poll_ms, DfuState.DFU_IDLE).encode()
