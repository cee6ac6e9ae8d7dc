"""The numbers of SPEC.md are those of the code: whoever changes one must change the other."""

from __future__ import annotations

import re

import pytest
from phasewire.protocol import board, codes, console, dfu, framing, numbering, timing
from phasewire.protocol.codes import Bank, Request
from phasewire.protocol.requests import VALUES

from tests import specification

WORDS = ("one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten")
DIGITS = {
    **{word: str(number) for number, word in enumerate(WORDS, 1)},
    "2³²": str(2**32),
    "2³¹": str(2**31),
    "fifth": "5th",
    "thirteenth": "13th",
}

WATCHDOG_VALUES = VALUES[Request.WATCHDOG]

SENTENCES = [
    ("TIM-001", "({} MHz)", board.TICK_HZ // 10**6),
    ("TIM-001", "A *period* is {} ticks", board.TICKS_PER_PERIOD),
    ("TIM-001", "one period of the {} kHz carrier", board.CARRIER_HZ // 1000),
    ("TIM-002", "within {} s of power-up", codes.RESTART_SECONDS),
    ("PUL-001", "in half ticks (0 to {})", board.HALF_TICKS_PER_PERIOD - 1),
    ("PUL-001", "*width* in ticks (0 to {})", board.MAX_WIDTH_TICKS),
    ("PUL-006", "sample s (0 to {})", codes.AMPLITUDES - 1),
    ("BLK-001", "a block of exactly {} bytes", codes.BLOCK_BYTES),
    ("BLK-002", "a header of {} bytes", codes.HEADER_BYTES),
    ("BLK-002", "a payload of {}", codes.PAYLOAD_BYTES),
    ("BLK-002", "| {} | 4 | checksum |", codes.CHECKSUM_OFFSET),
    ("BLK-005", "Period {} stands for", codes.NOW),
    ("BLK-005", "names the {}th period or a later one", codes.PROMISED_PERIODS),
    ("BLK-006", "is {} pulses", board.CHANNELS),
    ("BLK-010", "a period more than {} (about", codes.HORIZON_PERIODS),
    ("BLK-011", "| 1 to {} | | | | count entries |", codes.ENTRIES_PER_BLOCK),
    ("BLK-011", "| 1 to {} | | | | count samples |", codes.SAMPLES_PER_BLOCK),
    ("BLK-013", "There are {} slots", codes.SLOTS),
    ("BLK-014", "a table of {}", codes.SEQUENCE_ENTRIES),
    ("BLK-016", "a buffer of {}", codes.MODULATION_SAMPLES),
    ("BLK-022", "at most {} periods after", codes.SILENT_PERIODS),
    ("NUM-002", "mod 2³² < {}", numbering._AHEAD),
    ("ACK-002", "An acknowledgement has {} bytes", codes.RECORD_BYTES),
    ("SAF-003", "for the watchdog time, {} ms by default", board.WATCHDOG_MS),
    ("SAF-004", "within {} periods of that", codes.SILENT_PERIODS),
    ("SAF-004", "period P + {} at the latest", codes.SILENT_PERIODS),
    ("SAF-006", "at most {}; a host may lower it", board.CHANNELS),
    ("SAF-008", "a board is above {} °C", codes.TEMPERATURE_LIMIT_C),
    ("SAF-008", "amplifiers is outside {} to", codes.SUPPLY_RANGE_MV[0] // 1000),
    ("SAF-008", "to {} V |", codes.SUPPLY_RANGE_MV[-1] // 1000),
    ("REQ-002", "| ticks_per_period | {} |", board.TICKS_PER_PERIOD),
    ("REQ-002", "| max_width_ticks | {} |", board.MAX_WIDTH_TICKS),
    ("REQ-004", "WIRING answers {} bytes", 2 * board.CHANNELS),
    ("REQ-004", "(board·{} + processor)", board.PROCESSORS_PER_BOARD),
    ("REQ-009", "to `value` ms, {} to", WATCHDOG_VALUES[0]),
    ("REQ-009", "to {}, until power is lost", WATCHDOG_VALUES[-1]),
    ("REQ-011", "of TEMPERATURE below {} °C", codes.CLEARED_BELOW_C),
    ("USB-013", "wDetachTimeOut is {} ms", codes.DFU_DETACH_TIMEOUT_MS),
    ("USB-013", "wTransferSize {} bytes", codes.DFU_TRANSFER_BYTES),
    ("CHN-001", "The {} processors form a chain", board.PROCESSORS),
    ("CHN-003", "the {} pulses of one processor", board.CHANNELS_PER_PROCESSOR),
    ("CHN-013", "fits the {} bytes of a processor's memory", timing.PROCESSOR_MEMORY_BYTES),
    ("CHN-017", "a report once in {} ms", codes.COLLECT_MS),
    ("CHN-017", "leaves {} questions running", codes.COLLECTIONS_MISSED),
    ("CHN-018", "no valid collect for {} ms", codes.DEAF_MS),
    ("CHN-021", "within {} ms means a broken chain", codes.STALL_MS),
    ("CHN-023", "had none for {} ms since its start", codes.LINK_MS),
    ("CHN-023", "none came within {} ms", codes.NUMBER_MS),
    ("CHN-026", "every {}th period after that", codes.SYNC_PERIODS),
    ("CHN-027", "More than {} tick off", codes.SYNC_TOLERANCE_TICKS),
    ("BUD-001", ": {} make a tick", board.CYCLES_PER_TICK),
    ("BUD-001", ", {} a period", board.CYCLES_PER_PERIOD),
    ("BUD-003", "a {}th of a microframe", timing.PACKETS_PER_MICROFRAME),
    ("BUD-003", "| {} | `sort` |", timing.SORT_CYCLES),
    ("BUD-003", "| {} | `rasterise` |", timing.RASTERISE_CYCLES),
    ("BUD-005", "bytes of {} bits", framing.UART_BITS_PER_BYTE),
    ("BUD-006", "which takes {} cycles", timing.RASTERISE_CYCLES + timing.MODULATE_CYCLES),
    ("BUD-008", "A core runs at {} MHz", board.CORE_HZ // 10**6),
    ("BUD-008", "one instruction in {} cycles at most", timing.LEAST_CYCLES_PER_INSTRUCTION),
    ("BUD-008", "needs {} million instructions a second", timing.USB_INSTRUCTIONS_PER_SECOND // 10**6),
    ("BUD-008", "the controller runs {};", timing.CONTROLLER_THREADS),
    ("BUD-008", "a processor runs {}.", timing.PROCESSOR_THREADS),
    ("SER-001", "runs at {} baud", framing.BAUD),
    ("SER-003", "A piece of {} or more bytes", framing.COBS_GROUP_BYTES),
    ("SER-006", "whose `length` is above {} is damaged", codes.SERIAL_DATA_BYTES),
    ("CON-001", "at most {} printable ASCII characters", console.MAX_LINE_CHARACTERS),
    ("CON-008", "phase 0 and width {}", console.TEST_WIDTH_TICKS),
    ("FWU-002", "The header has {} bytes", codes.IMAGE_HEADER_BYTES),
    ("FWU-005", "chain of {} boards", board.BOARDS),
    ("FWU-006", "with {} bytes for each segment", codes.IMAGE_ENTRY_BYTES),
    ("FWU-008", "1 to {} bytes, the memory", codes.SEGMENT_MAX_BYTES),
    ("FWU-008", "= {} bytes", codes.IMAGE_MAX_BYTES),
    ("FWU-011", "The signature has {} bytes", codes.SIGNATURE_BYTES),
    ("FWU-011", "the first {} bytes of the SHA-256", codes.KEY_ID_BYTES),
    ("FWU-016", "with sectors of {} bytes", codes.FLASH_SECTOR_BYTES),
    ("FWU-016", "pages of {}.", dfu.PAGE_BYTES),
    ("FWU-016", "from {}h: written", int(f"{Bank.FACTORY.record_address:X}")),
    ("FWU-016", "from {}h: upgrades", int(f"{Bank.A.record_address:X}")),
    ("DFU-008", "{} ms to erase a sector", dfu.SECTOR_ERASE_MS),
    ("DFU-008", "{} ms to program a page", dfu.PAGE_PROGRAM_MS),
    ("DFU-008", "{} ms for manifestation", dfu.MANIFEST_MS),
    ("DFU-008", "not over after {} s MUST fail", dfu.BUSY_LONGEST_MS // 1000),
    ("DFU-009", "Blocks have {} bytes", codes.DFU_TRANSFER_BYTES),
    ("DFU-012", "the number {} + reason", codes.DFU_REASON_STRINGS),
    ("VER-001", "This is version {}.", codes.PROTOCOL_VERSION),
    ("VER-009", "This text is *revision* {} of version", codes.PROTOCOL_REVISION),
    *[("CHN-028", f"| {{}} | `{name}` |", getattr(codes, name)) for name in specification.codes("limits of the chain")],
]


def plain_numbers(text: str) -> str:
    """A text on one line, its numbers as Python writes them: ``six`` is 6, ``2³²`` and ``60 000`` in digits."""
    text = " ".join(text.split())
    text = re.sub(rf"\b(?:{'|'.join(DIGITS)})(?!\w)", lambda found: DIGITS[found[0]], text)
    return re.sub(r"(?<=\d) (?=\d{3}\b)", "", text)


CLAUSES = {
    clause: plain_numbers(text)
    for clause, text in re.findall(
        r"^\*\*([A-Z]{3}-\d{3})\*\* (.*?)(?=^\*\*[A-Z]{3}-\d{3}\*\*|\Z)", specification.SPEC, re.MULTILINE | re.DOTALL
    )
}


@pytest.mark.parametrize(("clause", "sentence", "value"), SENTENCES, ids=[f"{row[0]}: {row[1]}" for row in SENTENCES])
def test_a_number_of_the_specification_is_the_code_s(clause: str, sentence: str, value: int) -> None:
    assert plain_numbers(sentence.format(value)) in CLAUSES[clause]
