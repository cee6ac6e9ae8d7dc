"""Write the vectors of the protocol as constant C tables: `vectors_to_c.py vectors.json vectors.h`.

`TABLES` says which part of vectors.json becomes which table: an array `vec_<name>` of structs, which is walked with
VEC_COUNT. A row is a vector's columns in the struct's order, or the fields of it that are not 0. Codes become the names
of codes.h, never numbers: so the tests check codes.h as well.
"""

import json
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, NamedTuple

Case = dict[str, Any]
Row = Iterable[object] | Case

# Where codes.h avoids two codes of one name.
CODES = {"ENTRIES": "PW_STORE_ENTRIES", "SAMPLES": "PW_STORE_SAMPLES", "SEQUENCE": "PW_SEQUENCE"}
REASONS = {"FAULT": "PW_FAULTED", "SEQUENCE": "PW_OUT_OF_SEQUENCE"}
STATUS_FLAGS = {"SEQUENCE": "PW_SEQUENCE_PLAYS", "MODULATION": "PW_MODULATION_PLAYS"}


def quoted(text: str) -> str:
    """A C string, anything unusual in it as octal."""
    plain = [c if " " <= c <= "~" and c not in '"\\?' else "".join(f"\\{b:03o}" for b in c.encode()) for c in text]
    return f'"{"".join(plain)}"'


def braces(values: Iterable[object]) -> str:
    """An initializer."""
    return f"{{ {', '.join(map(str, values))} }}"


def array(ctype: str, values: Iterable[object]) -> str:
    """The address of a constant array; C99 has no empty one, so that has one 0."""
    return f"(const {ctype}[]){braces(list(values) or ['0'])}"


def packed(text: str) -> str:
    """The bytes of a hexadecimal text within a struct."""
    return braces(bytes.fromhex(text))


def data(text: str) -> str:
    """The address of the bytes of a hexadecimal text."""
    return array("uint8_t", bytes.fromhex(text))


def latin(text: str) -> str:
    """The address of the bytes of a line of text, of which a character stands for one byte."""
    return array("uint8_t", text.encode("latin-1"))


def runs(pulses: list[list[int]]) -> str:
    """The address of runs of pulses, as triples: phase, width, how many; or of pairs."""
    return array("uint16_t", [n for run in pulses for n in run])


def truth(value: bool) -> str:
    """A bool of C."""
    return str(value).lower()


def flags(names: list[str], special: dict[str, str] | None = None, prefix: str = "PW_") -> str:
    """A set of flags as a constant expression."""
    return " | ".join((special or {}).get(n, prefix + n) for n in names) or "0"


def reason(name: str) -> str:
    """A reason of ACK-003."""
    return REASONS.get(name, "PW_" + name)


def unsigned(fields: Case) -> Case:
    """Fields whose whole numbers are constants of 64 bits where they need it."""
    return {k: f"{v}ull" if type(v) is int and v >= 2**31 else v for k, v in fields.items()}


def sized(v: Case) -> tuple[object, ...]:
    """Name, bytes and size of a vector."""
    return quoted(v["name"]), data(v["hex"]), len(v["hex"]) // 2


SIZED = "const char *name; const uint8_t *bytes; uint16_t size;"


def pulse_pair(v: Case) -> Row:
    """Two pulses in three bytes."""
    return quoted(v["name"]), packed(v["hex"]), braces(map(braces, v["pulses"])), braces(v["begins"])


def block(v: Case) -> Row:
    """A valid block, and what it says."""
    f = dict(v["fields"])
    known = {"kind", "flags", "action", "sequence", "period", "first", "count", "hold", "repeats"}
    assert set(f) <= known | {"pulses", "entries", "samples"}, v["name"]
    f["kind"], f["flags"] = CODES.get(f["kind"], "PW_" + f["kind"]), flags(f["flags"])
    if "action" in f:
        f["action"] = "PW_" + f["action"]
    if "pulses" in f:
        f |= {"run_count": len(f["pulses"]), "runs": runs(f.pop("pulses"))}
    if "entries" in f:
        f |= {"entry_count": len(f["entries"]), "entries": runs(f["entries"])}
    if "samples" in f:
        f |= {"sample_count": len(f["samples"]) // 2, "samples": data(f["samples"])}
    return {"name": quoted(v["name"]), "bytes": data(v["hex"])} | unsigned(f)


def ack(v: Case) -> Row:
    """An acknowledgement."""
    f = v["fields"]
    codes = {"state": "PW_STATE_" + f["state"], "reason": reason(f["reason"]), "flags": flags(f["flags"])}
    return quoted(v["name"]), packed(v["hex"]), designated(unsigned(f | codes))


def status(v: Case) -> Row:
    """A status record."""
    f = v["fields"]
    codes = {
        "state": "PW_STATE_" + f["state"],
        "last_refusal": reason(f["last_refusal"]),
        "faults": flags(f["faults"], prefix="PW_FAULT_"),
        "flags": flags(f["flags"], STATUS_FLAGS),
    }
    return quoted(v["name"]), packed(v["hex"]), designated(unsigned(f | codes))


def chain_message(v: Case) -> Row:
    """A message of any kind; the end says which fields count."""
    f = dict(v["fields"])
    if "pulses" in f:
        f |= {"run_count": len(f["pulses"]), "runs": runs(f.pop("pulses"))}
    if "data" in f:
        f |= {"data_size": len(f["data"]) // 2, "data": data(f["data"])}
    if "firmware" in f:
        f["firmware"] = braces(f["firmware"])
    if "last" in f:
        f["last"] = int(f["last"])
    for name, prefix in (("memory", "PW_MEMORY_"), ("answer", "PW_END_")):
        if name in f:
            f[name] = prefix + f[name]
    head = {"name": quoted(v["name"]), "bytes": data(v["hex"]), "size": len(v["hex"]) // 2}
    return head | {"end": "PW_END_" + v["kind"]} | unsigned(f)


def slice_and_commit(v: Case) -> Row:
    """A whole slice and its commit, with their route headers."""
    assert (len(v["slice"]), len(v["commit"])) == (2 * 51, 2 * 15)
    return quoted(v["name"]), data(v["slice"]), data(v["commit"]), truth(v["plays"])


def frame(v: Case) -> Row:
    """A frame, with what a REQUEST or a REPLY says."""
    f = {key: value for key, value in v.get("fields", {}).items() if key != "data"}
    if "outcome" in f:
        f["outcome"] = "PW_" + f["outcome"]
    return {
        "name": quoted(v["name"]),
        "bytes": data(v["hex"]),
        "body": data(v["body"]),
        "size": len(v["hex"]) // 2,
        "body_size": len(v["body"]) // 2,
        "kind": "PW_FRAME_" + v["type"],
        "code": v["code"],
        "to_device": truth(v["goes"] in ("to the device", "both ways")),
        "to_host": truth(v["goes"] in ("to the host", "both ways")),
    } | f


def stream(v: Case) -> Row:
    """Bytes on a new line, and what they are, in order."""
    events = []
    for e in v["events"]:
        content = e.get("text", e.get("body", ""))
        what = {"text": "VEC_TEXT", "frame": "VEC_FRAME", "dropped": "VEC_DROPPED"}.get(next(iter(e)))
        kind = "PW_FRAME_" + e["frame"] if "frame" in e else "0"
        size = e.get("dropped", len(content) // 2)
        events.append(braces((what or "VEC_" + e["mode"], kind, data(content), size)))
    return *sized(v), len(events), array("struct vec_event", events)


def typing(v: Case) -> Row:
    """What is typed, the lines that it makes, each with its size before it, and what is shown."""
    made = array("uint8_t", [b for line in v["lines"] for b in (len(line), *line.encode("latin-1"))])
    sizes = len(v["typed"]) // 2, len(v["shown"]) // 2, len(v["lines"])
    return quoted(v["name"]), data(v["typed"]), data(v["shown"]), made, *sizes, truth(v["echo"])


def command(v: Case) -> Row:
    """A line of a console; a command that is NULL is none, an argument of -1 too."""
    argument = -1 if v.get("argument") is None else v["argument"]
    error = f"PW_CONSOLE_{v['error']}" if "error" in v else "0"
    name = "NULL" if v.get("command") is None else quoted(v["command"])
    return quoted(v["name"]), name, latin(v["line"]), len(v["line"]), error, v.get("code", 0), argument


def exchange(v: Case) -> Row:
    """A line of a console, and what the device sends after it."""
    return (
        quoted(v["name"]),
        quoted(v["line"]),
        quoted(v["of"]) if "of" in v else "NULL",
        latin(v["answer"]),
        len(v["answer"]),
    )


def image(v: Case) -> Row:
    """A valid firmware file, with its suffix."""
    assert v["reason"] == "ACCEPTED"
    return *sized(v), braces(v["version"]), packed(v["key_id"])


def refused_image(v: Case) -> Row:
    """A file that is refused, and what GETSTATUS says of it."""
    return *sized(v), f"PW_IMAGE_{v['reason']}", v["code"], f"PW_DFU_{v['dfu_status']}", v["dfu_string"]


def boot_record(v: Case) -> Row:
    """What stands at the beginning of a bank."""
    row: Case = {"name": quoted(v["name"]), "bytes": packed(v["hex"]), "may_boot": truth(v["may_boot"])}
    if f := v["fields"]:
        row |= {"valid": "true", "digest": packed(f["digest"])}
        row |= unsigned({name: f[name] for name in ("generation", "size", "started", "confirmed")})
    return row


def dfu_state(name: str) -> str:
    """PW_DFU_IDLE is the one whose name begins with DFU itself."""
    return "PW_DFU_" + name.removeprefix("DFU_")


def dfu_reply(v: Case) -> Row:
    """An answer to GETSTATUS."""
    f = v["fields"]
    codes = {"status": "PW_DFU_" + f["status"], "state": dfu_state(f["state"])}
    return quoted(v["name"]), packed(v["hex"]), designated(f | codes)


def dfu_block(v: Case) -> Row:
    """A block of a download; poll_ms is 0 where nothing is written."""
    numbers = (v[name] for name in ("block", "length", "received", "total"))
    return quoted(v["name"]), *numbers, f"PW_DFU_{v['status']}", v["poll_ms"] or 0


def descriptor(v: Case) -> Row:
    """A descriptor by speed and mode; no bytes are a STALL."""
    mode = {"run time, high speed": (True, False), "run time, full speed": (False, False), "DFU mode": (True, True)}
    answer = ("NULL", 0) if v["hex"] is None else (data(v["hex"]), len(v["hex"]) // 2)
    return quoted(v["name"]), *map(truth, mode[v["mode"]]), packed(v["setup"]), *answer


def setup(v: Case) -> Row:
    """A SETUP packet, and how many bytes answer it: -1 is a STALL."""
    f = v["fields"]
    kind, _, unit = v["answer"].partition(" ")
    answer = int(kind) if unit == "bytes" else {"nothing": 0, "STALL": -1}[kind]
    numbers = braces(f[name] for name in ("request_type", "request", "value", "index", "length"))
    return quoted(v["name"]), packed(v["hex"]), numbers, answer


def packet(v: Case) -> Row:
    """A packet on bulk IN, and the names of its records."""
    return *sized(v), array("char *const", map(quoted, v["records"])), len(v["records"])


class Table(NamedTuple):
    """A table of the header, and the part of vectors.json it is of; without members its struct stands above."""

    part: str
    name: str
    struct: str
    members: str
    row: Callable[[Case], Row]
    only: Callable[[Case], bool] = lambda _: True


TABLES = (
    Table("pulse_pairs", "pulse_pairs", "pulse_pair",
          "const char *name; uint8_t bytes[3]; uint8_t pulses[2][2]; uint8_t begins[2];", pulse_pair),
    Table("powers", "drives", "drive", "const char *name; const uint16_t *runs; uint16_t run_count; uint32_t power;",
          lambda v: (quoted(v["name"]), runs(v["pulses"]), len(v["pulses"]), v["total_drive"]),
          lambda v: "width" not in v),
    Table("blocks", "blocks", "block",
          """const char *name; const uint8_t *bytes; uint8_t kind, flags, action; uint32_t sequence; uint64_t period;
          uint16_t first, count, hold, repeats; const uint16_t *runs; /* triples */ const uint16_t *entries; /* pairs */
          const uint8_t *samples; uint16_t run_count, entry_count, sample_count;""", block),
    Table("refused_blocks", "refused_blocks", "refused", SIZED + " uint8_t reason, code;",
          lambda v: (*sized(v), reason(v["reason"]), v["code"])),
    Table("records", "acks", "ack", "const char *name; uint8_t bytes[32]; struct pw_ack fields;",
          ack, lambda v: v["record"] == "ACK"),
    Table("records", "statuses", "status", "const char *name; uint8_t bytes[64]; struct pw_status fields;",
          status, lambda v: v["record"] != "ACK"),
    Table("device_transitions", "device_transitions", "transition", "uint8_t state, event, next;",
          lambda v: (f"PW_STATE_{v['state']}", f"PW_EVENT_{v['event']}", f"PW_STATE_{v['next']}")),
    Table("chain_messages", "chain_messages", "chain",
          """const char *name; const uint8_t *bytes; uint8_t size, end; uint16_t node;
          const uint16_t *runs; /* triples */ const uint8_t *data; uint16_t run_count, data_size;
          uint8_t memory, answer, number, processor, last; uint16_t first, count, hold, repeats, faults;
          int8_t temperature_c, drift; uint8_t firmware[3];
          uint32_t checksum, carried_out, missed_commits, damaged_messages; uint64_t period, unique_id;""",
          chain_message),
    Table("refused_chain_messages", "refused_chain_messages", "refused_chain",
          "const char *name; const uint8_t *bytes; uint8_t size;", sized),
    Table("slices_and_commits", "slices_and_commits", "commit",
          "const char *name; const uint8_t *slice; const uint8_t *commit; bool plays;", slice_and_commit),
    Table("answers", "wirings", "wiring", "const char *name; const uint16_t *channels;",
          lambda v: (quoted(v["name"]), array("uint16_t", v["fields"]["channels"])),
          lambda v: v["request"] == "WIRING"),
    Table("frames", "frames", "frame",
          """const char *name; const uint8_t *bytes, *body; uint16_t size, body_size; uint8_t kind, code;
          bool to_device, to_host; uint8_t tag, request_type, request, outcome; uint16_t value, index, length;""",
          frame),
    Table("refused_frames", "refused_frames", "refused_frame", SIZED, sized),
    Table("streams", "streams", "stream", SIZED + " uint16_t event_count; const struct vec_event *events;", stream),
    Table("typing", "typings", "typing",
          """const char *name; const uint8_t *typed, *shown, *lines; uint16_t typed_size, shown_size;
          uint8_t line_count; bool echo;""", typing),
    Table("commands", "commands", "command",
          "const char *name, *command; const uint8_t *line; uint8_t size, error, code; int32_t argument;", command),
    Table("exchanges", "exchanges", "exchange",
          "const char *name, *line, *of; const uint8_t *answer; uint16_t size;", exchange),
    Table("answers", "console_data", "console_datum", SIZED, sized,
          lambda v: v["request"] in ("INFO", "CLOCK", "PROCESSORS")),
    Table("images", "images", "image", SIZED + " uint8_t version[3], key_id[8];", image),
    Table("refused_images", "refused_images", "refused_image",
          SIZED + " uint8_t reason, code, dfu_status, dfu_string;", refused_image),
    # Whether a device that trusts the first one's key may store them.
    Table("signatures", "signatures", "signature", SIZED + " bool trusted;",
          lambda v: (*sized(v), truth(v["outcome"] == "SIGNED"))),
    Table("boot_records", "boot_records", "boot_record",
          """const char *name; uint8_t bytes[56]; bool valid, may_boot;
          uint32_t generation, size, started, confirmed; uint8_t digest[32];""", boot_record),
    Table("boot_orders", "boot_orders", "boot_order", "const char *name, *a, *b; uint8_t count, order[3];",
          lambda v: (*map(quoted, (v["name"], v["a"], v["b"])), len(v["order"]),
                     braces(f"PW_BANK_{bank}" for bank in v["order"]))),
    Table("dfu_replies", "dfu_replies", "dfu_reply",
          "const char *name; uint8_t bytes[6]; struct pw_dfu_reply fields;", dfu_reply),
    Table("dfu_blocks", "dfu_blocks", "dfu_block",
          "const char *name; uint32_t block, length, received, total; uint8_t status; uint32_t poll_ms;", dfu_block),
    Table("dfu_transitions", "dfu_transitions", "dfu_transition", "uint8_t state, event, next; bool stalls;",
          lambda v: (dfu_state(v["state"]), f"PW_DFU_ON_{v['event']}", dfu_state(v["next"]), truth(v["stalls"]))),
    Table("descriptors", "descriptors", "descriptor",
          """const char *name; bool high_speed, dfu_mode; uint8_t setup[8];
          const uint8_t *bytes; /* NULL: STALL */ uint16_t size;""", descriptor),
    Table("requests", "requests", "setup",
          "const char *name; uint8_t bytes[8]; uint16_t fields[5]; int answer;", setup),
    Table("refused_requests", "refused_requests", "setup", "", setup),
    Table("packets", "packets", "packet", SIZED + " const char *const *records; uint8_t record_count;", packet),
)  # fmt: skip

BEGIN = """\
/* Made by vectors_to_c.py from protocol/vectors.json. Do not edit. */
#ifndef VECTORS_H
#define VECTORS_H

#include "ack.h"
#include "bytes.h"
#include "codes.h"
#include "dfu.h"

#define VEC_COUNT(table) (sizeof(table) / sizeof((table)[0]))

enum vec_event_what { VEC_TEXT, VEC_FRAMES, VEC_CONSOLE, VEC_FRAME, VEC_DROPPED };
struct vec_event { uint8_t what, kind; const uint8_t *bytes; uint16_t size; };
"""


def designated(row: Row) -> str:
    """The initializer of a struct."""
    return braces(f".{key} = {value}" for key, value in row.items()) if isinstance(row, dict) else braces(row)


def widths_and_powers(modulated: list[Case], powers: list[Case]) -> list[str]:
    """All widths under all samples, and a power for each width: arrays by index."""
    assert [v["sample"] for v in modulated] == list(range(256))
    by_width = {v["width"]: v["power"] for v in powers if "width" in v}
    assert sorted(by_width) == list(range(26))
    rows = [f"    {braces(v['widths'])}," for v in modulated]
    lines = ["static const uint8_t vec_modulated_widths[256][26] = {", *rows, "};"]
    return [*lines, f"static const uint16_t vec_powers[] = {braces(by_width[w] for w in range(26))};"]


def main(source: str, target: str) -> None:
    """Write all tables."""
    vectors = json.loads(Path(source).read_text(encoding="utf-8"))
    assert vectors["format"] == "phasewire-vectors-1"
    lines = [BEGIN, *widths_and_powers(vectors["modulated_widths"]["vectors"], vectors["powers"]["vectors"])]
    for table in TABLES:
        lines += ["", f"/* {table.part} */"]
        if table.members:
            lines.append(f"struct vec_{table.struct} {{ {table.members} }};")
        rows = [f"    {designated(table.row(v))}," for v in vectors[table.part]["vectors"] if table.only(v)]
        lines += [f"static const struct vec_{table.struct} vec_{table.name}[] = {{", *rows, "};"]
    Path(target).write_text("\n".join([*lines, "", "#endif", ""]), encoding="ascii")


if __name__ == "__main__":
    main(*sys.argv[1:])
