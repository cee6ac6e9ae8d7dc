"""The codes and limits that travel: versions, magics, kinds, flags, reasons, requests, states, faults.

One source for all of them; the tables of SPEC.md are checked against this file.
"""

from __future__ import annotations

from enum import IntEnum, IntFlag

from .board import PROCESSORS

__all__ = [
    "ACK_MAGIC",
    "AMPLITUDES",
    "BLOCK_BYTES",
    "BLOCK_MAGIC",
    "BOOT_RECORD_MAGIC",
    "CHECKSUM_OFFSET",
    "CLASS_REQUEST_TYPE_IN",
    "CLASS_REQUEST_TYPE_OUT",
    "CLEARED_BELOW_C",
    "COLLECTIONS_MISSED",
    "COLLECT_MS",
    "CONTROLLER_NODE",
    "DEAF_MS",
    "DFU_ATTRIBUTES",
    "DFU_DETACH_TIMEOUT_MS",
    "DFU_REASON_STRINGS",
    "DFU_TRANSFER_BYTES",
    "DFU_VERSION",
    "END_TOKEN",
    "ENTRIES_PER_BLOCK",
    "FLASH_BANK_BYTES",
    "FLASH_SECTOR_BYTES",
    "HEADER_BYTES",
    "HORIZON_PERIODS",
    "IMAGE_ENTRY_BYTES",
    "IMAGE_HEADER_BYTES",
    "IMAGE_MAGIC",
    "IMAGE_MAX_BYTES",
    "IMAGE_VERSION",
    "KEY_ID_BYTES",
    "LINK_MS",
    "MODULATION_SAMPLES",
    "NOW",
    "NUMBER_MS",
    "PAYLOAD_BYTES",
    "PROMISED_PERIODS",
    "PROTOCOL_REVISION",
    "PROTOCOL_VERSION",
    "RECORD_BYTES",
    "REQUEST_TYPE_IN",
    "REQUEST_TYPE_OUT",
    "RESTART_SECONDS",
    "SAMPLES_PER_BLOCK",
    "SEGMENT_MAX_BYTES",
    "SEQUENCE_ENTRIES",
    "SERIAL_DATA_BYTES",
    "SIGNATURE_BYTES",
    "SILENCING_FAULTS",
    "SILENT_PERIODS",
    "SLOTS",
    "STALL_MS",
    "STATUS_MAGIC",
    "SUPPLY_RANGE_MV",
    "SYNC_PERIODS",
    "SYNC_TOLERANCE_TICKS",
    "TEMPERATURE_LIMIT_C",
    "UNNUMBERED_NODE",
    "AckFlag",
    "Action",
    "Bank",
    "ChannelEnd",
    "ConsoleCode",
    "DescriptorType",
    "DfuRequest",
    "DfuState",
    "DfuStatus",
    "Fault",
    "Feature",
    "Flag",
    "FrameKind",
    "Hardware",
    "ImageReason",
    "Kind",
    "Memory",
    "Outcome",
    "Reason",
    "Request",
    "StandardRequest",
    "State",
    "StatusFlag",
    "Target",
]

PROTOCOL_VERSION = 1
PROTOCOL_REVISION = 3
"""Of the text of that version (clause VER-009)."""
RESTART_SECONDS = 15
"""In which a device answers after power-up and all that restarts it (clause TIM-002)."""

BLOCK_MAGIC = b"PW"
BLOCK_BYTES = 512
HEADER_BYTES = 32
PAYLOAD_BYTES = BLOCK_BYTES - HEADER_BYTES
CHECKSUM_OFFSET = 28

NOW = 0
"""The period that stands for "as soon as possible"."""
HORIZON_PERIODS = 2**32
PROMISED_PERIODS = 5
"""A change that names this period after the one in which its block arrived is in time (clause BLK-005)."""
SILENT_PERIODS = 6
"""After so many periods at most all outputs are silent that were turned off (clause SAF-004)."""

SLOTS = 256
SEQUENCE_ENTRIES = 1024
ENTRIES_PER_BLOCK = PAYLOAD_BYTES // 4
MODULATION_SAMPLES = 4096
SAMPLES_PER_BLOCK = PAYLOAD_BYTES
AMPLITUDES = 256
"""Values of a modulation sample; the largest leaves a pulse as it is."""

ACK_MAGIC = b"PA"
STATUS_MAGIC = b"PS"
RECORD_BYTES = 32
"""Everything on bulk IN is a whole number of these."""

REQUEST_TYPE_IN = 0xC1
REQUEST_TYPE_OUT = 0x41
CLASS_REQUEST_TYPE_IN = 0xA1
CLASS_REQUEST_TYPE_OUT = 0x21


class Kind(IntEnum):
    """What a block asks for (clause BLK-004)."""

    UPDATE = 1
    SLOT = 2
    ENTRIES = 3
    SEQUENCE = 4
    SAMPLES = 5
    MODULATION = 6
    OUTPUT = 7
    CLOCK = 8
    NO_OP = 9


class Flag(IntFlag):
    """Flags of a block (clause BLK-011)."""

    RESTART = 1
    UNATTENDED = 2


class Action(IntEnum):
    """What an OUTPUT block does (clause BLK-018)."""

    END_MODULATION = 1
    SILENCE = 2
    DISABLE = 3


class Reason(IntEnum):
    """Outcome of a block (clause ACK-003). The first failure in this order is the one reported."""

    ACCEPTED = 0
    LENGTH = 1
    CHECKSUM = 2
    MAGIC = 3
    VERSION = 4
    KIND = 5
    FIELD = 6
    PULSE = 7
    UNSUPPORTED = 8
    FAULT = 9
    DISABLED = 10
    SEQUENCE = 11
    HORIZON = 12
    RATE = 13
    DRIVE = 14
    EMPTY = 15
    IN_USE = 16

    @property
    def clause(self) -> str:
        """The clause that a block refused for this reason breaks."""
        return _REASONS[self][0]

    @property
    def text(self) -> str:
        """What it means, for people."""
        return _REASONS[self][1]

    def with_values(self, **values: object) -> str:
        """What it means, with the values of the block and of the device if both are known.

        Parameters
        ----------
        values : object
            Those that `text` leaves out: ``sequence`` and ``last`` for SEQUENCE; ``period`` and ``arrived`` for
            HORIZON; ``period``, ``named`` and ``least`` for RATE; ``drive`` and ``limit``, in transducers, for DRIVE.
        """
        return _WITH_VALUES[self].format(**values)


_WITH_VALUES = {
    Reason.SEQUENCE: "number {sequence} does not follow {last}, the last accepted one",
    Reason.HORIZON: "period {period} is more than 2**32 ahead of {arrived}, in which the block had arrived",
    Reason.RATE: "period {period} follows {named}, and the chain needs {least} periods for an update",
    Reason.DRIVE: "a total drive of {drive:g} is above the limit of {limit}",
}
_REASONS = {
    Reason.ACCEPTED: ("ACK-001", "accepted"),
    Reason.LENGTH: ("BLK-001", "the block is not exactly 512 bytes long"),
    Reason.CHECKSUM: ("BLK-003", "the block's CRC-32 does not match its bytes"),
    Reason.MAGIC: ("BLK-002", "the block does not begin with the magic bytes"),
    Reason.VERSION: ("VER-002", "the block is of another protocol version"),
    Reason.KIND: ("BLK-004", "the block is of an unknown kind"),
    Reason.FIELD: ("BLK-011", "a field has a value that its kind does not allow"),
    Reason.PULSE: ("PUL-001", "a pulse has a phase above 99 half ticks or a width above 25 ticks"),
    Reason.UNSUPPORTED: ("VER-005", "the device has no such feature"),
    Reason.FAULT: ("SAF-007", "a fault has silenced the device; clear it first"),
    Reason.DISABLED: ("SAF-002", "the outputs are not enabled"),
    Reason.SEQUENCE: ("NUM-002", "the sequence number does not follow the last accepted one"),
    Reason.HORIZON: ("BLK-010", "the period is more than 2**32 ahead"),
    Reason.RATE: ("BLK-023", "the chain cannot carry updates that follow each other so closely"),
    Reason.DRIVE: ("SAF-006", "the total drive is above the limit"),
    Reason.EMPTY: ("BLK-021", "it would play what was never stored"),
    Reason.IN_USE: ("BLK-022", "it would overwrite what plays"),
}


class AckFlag(IntFlag):
    """Flags of an acknowledgement (clause ACK-004)."""

    LATE = 1
    GAP = 2


class StatusFlag(IntFlag):
    """Flags of a status (clause REQ-003)."""

    WATCHDOG_FIRED = 1
    SEQUENCE = 2
    MODULATION = 4


class Request(IntEnum):
    """Vendor control requests, addressed to the interface (clause REQ-001)."""

    INFO = 1
    STATUS = 2
    WIRING = 3
    ENABLE = 4
    DISABLE = 5
    WATCHDOG = 6
    LIMIT = 7
    CLEAR_FAULTS = 8
    CLOCK = 9
    PULSES = 10
    PROCESSORS = 11
    IDENTIFY = 12
    RESET = 13
    REVERT = 14


class State(IntEnum):
    """States of the device (clause STA-001)."""

    OFF = 0
    READY = 1
    PLAYING = 2
    UNATTENDED = 3
    FAULT = 4
    SUSPENDED = 5
    DFU = 6


class Fault(IntFlag):
    """What is wrong with the device (clause SAF-008)."""

    CHAIN = 1 << 0
    PROCESSOR = 1 << 1
    SYNC = 1 << 2
    TEMPERATURE = 1 << 3
    SUPPLY = 1 << 4
    OVERRUN = 1 << 5
    FLASH = 1 << 6


SILENCING_FAULTS = Fault.PROCESSOR | Fault.SYNC | Fault.TEMPERATURE | Fault.SUPPLY
"""Faults that take the device to the state FAULT; the others are only reported."""

TEMPERATURE_LIMIT_C = 85
"""A board above it has the fault TEMPERATURE (clause SAF-008)."""
CLEARED_BELOW_C = 80
"""The fault TEMPERATURE can be cleared below it (clause REQ-011)."""
SUPPLY_RANGE_MV = range(12_000, 18_001)
"""A board whose supply is not in it has the fault SUPPLY (clause SAF-008)."""


class Feature(IntFlag):
    """What a device may lack (clause VER-005)."""

    SEQUENCES = 1 << 0
    MODULATION = 1 << 1
    UNATTENDED = 1 << 2
    READ_BACK = 1 << 3
    CONSOLE = 1 << 4
    DFU = 1 << 5
    REVERT = 1 << 6


# Serial lines (chapters SER and CON)

SERIAL_DATA_BYTES = 640
"""Most data of a request or of its answer (clause SER-007)."""


class FrameKind(IntEnum):
    """What a frame on a serial line carries (clause SER-004)."""

    BLOCK = 1
    RECORD = 2
    REQUEST = 3
    REPLY = 4
    CONSOLE = 5


class Outcome(IntEnum):
    """What became of a request on a serial line (clause SER-008)."""

    DONE = 0
    STALL = 1


class ConsoleCode(IntEnum):
    """Why the console did not do as told (clause CON-006). The first in this order is the one reported."""

    LENGTH = 1
    CHARACTER = 2
    COMMAND = 3
    ARGUMENTS = 4
    RANGE = 5
    REFUSED = 6


# USB (chapter USB)


class StandardRequest(IntEnum):
    """Standard requests that the device answers (clause USB-014; USB 2.0, table 9-4)."""

    GET_STATUS = 0
    CLEAR_FEATURE = 1
    SET_FEATURE = 3
    SET_ADDRESS = 5
    GET_DESCRIPTOR = 6
    GET_CONFIGURATION = 8
    SET_CONFIGURATION = 9
    GET_INTERFACE = 10
    SET_INTERFACE = 11


class DescriptorType(IntEnum):
    """Types of the descriptors that the device has (clause USB-006)."""

    DEVICE = 0x01
    CONFIGURATION = 0x02
    STRING = 0x03
    INTERFACE = 0x04
    ENDPOINT = 0x05
    DEVICE_QUALIFIER = 0x06
    OTHER_SPEED_CONFIGURATION = 0x07
    INTERFACE_ASSOCIATION = 0x0B
    BOS = 0x0F
    DEVICE_CAPABILITY = 0x10
    DFU_FUNCTIONAL = 0x21
    CS_INTERFACE = 0x24


# Firmware images, flash and DFU (chapters FWU and DFU)

IMAGE_MAGIC = b"PWFW"
IMAGE_VERSION = 1
IMAGE_HEADER_BYTES = 32
IMAGE_ENTRY_BYTES = 48
KEY_ID_BYTES = 8
SIGNATURE_BYTES = 64
SEGMENT_MAX_BYTES = 64 * 1024
IMAGE_MAX_BYTES = IMAGE_HEADER_BYTES + (1 + PROCESSORS) * (IMAGE_ENTRY_BYTES + SEGMENT_MAX_BYTES) + SIGNATURE_BYTES

FLASH_SECTOR_BYTES = 4096
FLASH_BANK_BYTES = 1024 * 1024
BOOT_RECORD_MAGIC = b"PWBR"

DFU_VERSION = 0x0110
DFU_ATTRIBUTES = 0x0F
DFU_TRANSFER_BYTES = 2048
DFU_DETACH_TIMEOUT_MS = 1000
DFU_REASON_STRINGS = 16
"""Added to an `ImageReason` it is the index of the string that tells it (clause DFU-012)."""


class Hardware(IntEnum):
    """What an image is for (clause FWU-005)."""

    FIVE_BOARDS = 1


class Target(IntEnum):
    """The processor that runs a segment of an image (clause FWU-007)."""

    PROCESSOR_0 = 0
    PROCESSOR_1 = 1
    PROCESSOR_2 = 2
    PROCESSOR_3 = 3
    PROCESSOR_4 = 4
    PROCESSOR_5 = 5
    PROCESSOR_6 = 6
    PROCESSOR_7 = 7
    PROCESSOR_8 = 8
    PROCESSOR_9 = 9
    ALL_PROCESSORS = 10
    CONTROLLER = 11


class Bank(IntEnum):
    """Where an image lies in flash: the number is that of its MiB (clause FWU-016)."""

    FACTORY = 1
    A = 2
    B = 3

    @property
    def record_address(self) -> int:
        """Where the boot record lies, in bytes from the beginning of the flash."""
        return self * FLASH_BANK_BYTES

    @property
    def image_address(self) -> int:
        """Where the image begins, in bytes from the beginning of the flash."""
        return self.record_address + FLASH_SECTOR_BYTES


class ImageReason(IntEnum):
    """Outcome of a firmware image (clause FWU-015). The first failure in this order is the one reported."""

    ACCEPTED = 0
    SUFFIX = 1
    LENGTH = 2
    MAGIC = 3
    VERSION = 4
    CHECKSUM = 5
    RESERVED = 6
    HARDWARE = 7
    TARGETS = 8
    SIZE = 9
    OFFSET = 10
    TOTAL = 11
    PADDING = 12
    HASH = 13
    SIGNATURE = 14

    @property
    def clause(self) -> str:
        """The clause that an image refused for this reason breaks."""
        return _IMAGE_REASONS[self][0]

    @property
    def text(self) -> str:
        """What it means, for people."""
        return _IMAGE_REASONS[self][1]


_IMAGE_REASONS = {
    ImageReason.ACCEPTED: ("FWU-015", "accepted"),
    ImageReason.SUFFIX: ("FWU-014", "the file does not end with a DFU suffix that is right"),
    ImageReason.LENGTH: ("FWU-001", "there is less than the header and the table that it announces"),
    ImageReason.MAGIC: ("FWU-002", "this is no firmware image"),
    ImageReason.VERSION: ("FWU-002", "the image is of another container version"),
    ImageReason.CHECKSUM: ("FWU-003", "the CRC-32 of header and table does not match"),
    ImageReason.RESERVED: ("FWU-004", "a reserved byte is not zero, or a version has a reserved value"),
    ImageReason.HARDWARE: ("FWU-005", "the image is for other hardware"),
    ImageReason.TARGETS: ("FWU-007", "the segments are not one for the controller and one for each processor"),
    ImageReason.SIZE: ("FWU-008", "a segment is empty or larger than a processor's memory"),
    ImageReason.OFFSET: ("FWU-009", "the segments do not follow each other without gap or overlap"),
    ImageReason.TOTAL: ("FWU-009", "the image has more or fewer bytes than it says"),
    ImageReason.PADDING: ("FWU-009", "bytes between segments are not zero"),
    ImageReason.HASH: ("FWU-010", "a segment's CRC-32 or SHA-256 does not match"),
    ImageReason.SIGNATURE: ("FWU-011", "the signature is wrong, or the device does not trust who signed"),
}


class DfuRequest(IntEnum):
    """Class requests of USB DFU 1.1 (clause DFU-003)."""

    DETACH = 0
    DNLOAD = 1
    UPLOAD = 2
    GETSTATUS = 3
    CLRSTATUS = 4
    GETSTATE = 5
    ABORT = 6


class DfuState(IntEnum):
    """States of USB DFU 1.1 (clause DFU-004)."""

    APP_IDLE = 0
    APP_DETACH = 1
    DFU_IDLE = 2
    DNLOAD_SYNC = 3
    DNBUSY = 4
    DNLOAD_IDLE = 5
    MANIFEST_SYNC = 6
    MANIFEST = 7
    MANIFEST_WAIT_RESET = 8
    UPLOAD_IDLE = 9
    ERROR = 10


class DfuStatus(IntEnum):
    """Statuses of USB DFU 1.1 (clause DFU-005)."""

    OK = 0
    TARGET = 1
    FILE = 2
    WRITE = 3
    ERASE = 4
    CHECK_ERASED = 5
    PROG = 6
    VERIFY = 7
    ADDRESS = 8
    NOTDONE = 9
    FIRMWARE = 10
    VENDOR = 11
    USBR = 12
    POR = 13
    UNKNOWN = 14
    STALLEDPKT = 15


# The chain behind the controller (chapter CHN)

CONTROLLER_NODE = 0x00FF
UNNUMBERED_NODE = 0xFFFF
END_TOKEN = 0x01

COLLECT_MS = 10
COLLECTIONS_MISSED = 2
DEAF_MS = 50
STALL_MS = 1
LINK_MS = 1000
NUMBER_MS = 2000
SYNC_PERIODS = 4096
SYNC_TOLERANCE_TICKS = 1


class ChannelEnd(IntEnum):
    """Where a message arrives, and thereby what it is (clause CHN-009)."""

    SLICE = 1
    COMMIT = 2
    LOAD = 3
    PROGRAM = 4
    COLLECT = 5
    NUMBER = 6
    REPORT = 7
    PLAYING = 8
    IDENTITY = 9


class Memory(IntEnum):
    """What a processor stores besides what it plays (clause CHN-012)."""

    SLOTS = 1
    ENTRIES = 2
    SAMPLES = 3
