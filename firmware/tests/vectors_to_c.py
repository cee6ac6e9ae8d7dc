"""Write the vectors of the protocol as constant C tables: `vectors_to_c.py vectors.json vectors.h`.

One function for each part of vectors.json, named in PARTS; it returns the lines of its tables. A table is an array
`vec_<part>` of structs `struct vec_<singular>` and is walked with VEC_COUNT. Bytes are arrays of their own, so that
tables stay small; an empty one has one byte, and its size says 0. Codes become the names of codes.h, never numbers:
so the tests check codes.h as well.
"""

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

Case = dict[str, Any]

# Where codes.h avoids two codes of one name.
CODES = {"ENTRIES": "PW_STORE_ENTRIES", "SAMPLES": "PW_STORE_SAMPLES", "SEQUENCE": "PW_SEQUENCE"}
REASONS = {"FAULT": "PW_FAULTED", "SEQUENCE": "PW_OUT_OF_SEQUENCE"}
STATUS_FLAGS = {"SEQUENCE": "PW_SEQUENCE_PLAYS", "MODULATION": "PW_MODULATION_PLAYS"}


def quoted(text: str) -> str:
    """A C string; anything unusual in it as octal."""
    plain = [c if " " <= c <= "~" and c not in '"\\?' else "".join(f"\\{b:03o}" for b in c.encode()) for c in text]
    return f'"{"".join(plain)}"'


def rows_of(numbers: list[str]) -> list[str]:
    """Numbers as lines of an initializer, short enough to read."""
    return ["    " + ", ".join(numbers[i : i + 20]) + "," for i in range(0, len(numbers), 20)]


def array(ctype: str, name: str, values: list[int]) -> list[str]:
    """A constant array; C99 has no empty one."""
    return [f"static const {ctype} {name}[] = {{", *rows_of([str(v) for v in values] or ["0"]), "};"]


def data(name: str, text: str) -> list[str]:
    """The bytes of a hexadecimal text as an array."""
    return array("uint8_t", name, list(bytes.fromhex(text)))


def runs(name: str, pulses: list[list[int]]) -> list[str]:
    """Runs of pulses as triples: phase, width, how many."""
    return array("uint16_t", name, [n for run in pulses for n in run])


def flags(names: list[str], special: dict[str, str] | None = None, prefix: str = "PW_") -> str:
    """A set of flags as a constant expression."""
    return " | ".join((special or {}).get(n, prefix + n) for n in names) or "0"


def table(struct: str, part: str, rows: list[str]) -> list[str]:
    """The array of a part."""
    return [f"static const struct {struct} vec_{part}[] = {{", *(f"    {{ {row} }}," for row in rows), "};"]


def fields(**values: object) -> str:
    """A designated initializer; what is None stays 0."""
    return ", ".join(f".{key} = {value}" for key, value in values.items() if value is not None)


def u32(value: int | None) -> str | None:
    """A number as a constant of 32 bits."""
    return None if value is None else f"{value}u"


def u64(value: int | None) -> str | None:
    """A number as a constant of 64 bits."""
    return None if value is None else f"{value}ull"


def pulse_pairs(vectors: list[Case]) -> list[str]:
    """Two pulses in three bytes."""
    lines = ["struct vec_pulse_pair { const char *name; uint8_t bytes[3]; uint8_t pulses[2][2]; uint8_t begins[2]; };"]
    rows = []
    for v in vectors:
        packed = ", ".join(str(b) for b in bytes.fromhex(v["hex"]))
        pulses = ", ".join(f"{{ {p}, {w} }}" for p, w in v["pulses"])
        begins = ", ".join(map(str, v["begins"]))
        rows.append(f"{quoted(v['name'])}, {{ {packed} }}, {{ {pulses} }}, {{ {begins} }}")
    return lines + table("vec_pulse_pair", "pulse_pairs", rows)


def modulated_widths(vectors: list[Case]) -> list[str]:
    """All widths under all samples."""
    assert [v["sample"] for v in vectors] == list(range(256))
    lines = ["static const uint8_t vec_modulated_widths[256][26] = {"]
    return lines + [f"    {{ {', '.join(map(str, v['widths']))} }}," for v in vectors] + ["};"]


def powers(vectors: list[Case]) -> list[str]:
    """A power for each width, and total drives of 320 pulses."""
    widths = {v["width"]: v["power"] for v in vectors if "width" in v}
    assert sorted(widths) == list(range(26))
    lines = array("uint16_t", "vec_powers", [widths[w] for w in range(26)])
    lines.append("struct vec_drive { const char *name; const uint16_t *runs; uint16_t run_count; uint32_t power; };")
    rows = []
    for i, v in enumerate(v for v in vectors if "width" not in v):
        lines += runs(f"vec_drive_{i}", v["pulses"])
        rows.append(f"{quoted(v['name'])}, vec_drive_{i}, {len(v['pulses'])}, {u32(v['total_drive'])}")
    return lines + table("vec_drive", "drives", rows)


def blocks(vectors: list[Case]) -> list[str]:
    """Valid blocks, and what they say."""
    lines = [
        "struct vec_block {",
        "    const char *name;",
        "    const uint8_t *bytes;",
        "    uint8_t kind, flags, action;",
        "    uint32_t sequence;",
        "    uint64_t period;",
        "    uint16_t first, count, hold, repeats;",
        "    const uint16_t *runs; /* triples */",
        "    const uint16_t *entries; /* pairs */",
        "    const uint8_t *samples;",
        "    uint16_t run_count, entry_count, sample_count;",
        "};",
    ]
    rows = []
    for i, v in enumerate(vectors):
        f = v["fields"]
        known = {"kind", "flags", "action", "sequence", "period", "first", "count", "hold", "repeats"}
        assert set(f) <= known | {"pulses", "entries", "samples"}, v["name"]
        lines += data(f"vec_block_{i}", v["hex"])
        payload: Case = {}
        if "pulses" in f:
            lines += runs(f"vec_block_runs_{i}", f["pulses"])
            payload = {"runs": f"vec_block_runs_{i}", "run_count": len(f["pulses"])}
        if "entries" in f:
            lines += runs(f"vec_block_entries_{i}", f["entries"])
            payload = {"entries": f"vec_block_entries_{i}", "entry_count": len(f["entries"])}
        if "samples" in f:
            lines += data(f"vec_block_samples_{i}", f["samples"])
            payload = {"samples": f"vec_block_samples_{i}", "sample_count": len(f["samples"]) // 2}
        rows.append(
            fields(
                name=quoted(v["name"]),
                bytes=f"vec_block_{i}",
                kind=CODES.get(f["kind"], "PW_" + f["kind"]),
                flags=flags(f["flags"]),
                action="PW_" + f["action"] if "action" in f else None,
                sequence=u32(f["sequence"]),
                period=u64(f.get("period")),
                first=f.get("first"),
                count=f.get("count"),
                hold=f.get("hold"),
                repeats=f.get("repeats"),
                **payload,
            )
        )
    return lines + table("vec_block", "blocks", rows)


def refused_blocks(vectors: list[Case]) -> list[str]:
    """Blocks of any length, and the reason of their refusal."""
    lines = ["struct vec_refused { const char *name; const uint8_t *bytes; uint16_t size; uint8_t reason, code; };"]
    rows = []
    for i, v in enumerate(vectors):
        lines += data(f"vec_refused_{i}", v["hex"])
        reason = REASONS.get(v["reason"], "PW_" + v["reason"])
        rows.append(f"{quoted(v['name'])}, vec_refused_{i}, {len(v['hex']) // 2}, {reason}, {v['code']}")
    return lines + table("vec_refused", "refused_blocks", rows)


def records(vectors: list[Case]) -> list[str]:
    """Two tables, as the records are of two layouts."""
    lines = [
        "struct vec_ack { const char *name; uint8_t bytes[32]; struct pw_ack fields; };",
        "struct vec_status { const char *name; uint8_t bytes[64]; struct pw_status fields; };",
    ]
    acks, statuses = [], []
    for v in vectors:
        f = dict(v["fields"])
        packed = ", ".join(str(b) for b in bytes.fromhex(v["hex"]))
        f["state"] = "PW_STATE_" + f["state"]
        f["now"] = u64(f["now"])
        if v["record"] == "ACK":
            f["reason"] = REASONS.get(f["reason"], "PW_" + f["reason"])
            f["sequence"], f["commit_period"] = u32(f["sequence"]), u64(f["commit_period"])
            f["flags"] = flags(f["flags"])
            acks.append(f"{quoted(v['name'])}, {{ {packed} }}, {{ {fields(**f)} }}")
        else:
            f["last_refusal"] = REASONS.get(f["last_refusal"], "PW_" + f["last_refusal"])
            f["faults"] = flags(f["faults"], prefix="PW_FAULT_")
            f["flags"] = flags(f["flags"], STATUS_FLAGS)
            f["since_period"] = u64(f["since_period"])
            for name in ("accepted", "refused", "late", "lost", "missed_commits", "damaged_messages", "dropped_frames"):
                f[name] = u32(f[name])
            statuses.append(f"{quoted(v['name'])}, {{ {packed} }}, {{ {fields(**f)} }}")
    return lines + table("vec_ack", "acks", acks) + table("vec_status", "statuses", statuses)


def device_transitions(vectors: list[Case]) -> list[str]:
    """The state that follows, by state and event."""
    lines = ["struct vec_transition { uint8_t state, event, next; };"]
    rows = [f"PW_STATE_{v['state']}, PW_EVENT_{v['event']}, PW_STATE_{v['next']}" for v in vectors]
    return lines + table("vec_transition", "device_transitions", rows)


def chain_messages(vectors: list[Case]) -> list[str]:
    """One struct for all kinds; the end says which fields count."""
    lines = [
        "struct vec_chain {",
        "    const char *name;",
        "    const uint8_t *bytes;",
        "    uint8_t size, end;",
        "    uint16_t node;",
        "    const uint16_t *runs; /* triples */",
        "    const uint8_t *data;",
        "    uint16_t run_count, data_size;",
        "    uint8_t memory, answer, number, processor, last;",
        "    uint16_t first, count, hold, repeats, faults;",
        "    int8_t temperature_c, drift;",
        "    uint8_t firmware[3];",
        "    uint32_t checksum, carried_out, missed_commits, damaged_messages;",
        "    uint64_t period, unique_id;",
        "};",
    ]
    rows = []
    for i, v in enumerate(vectors):
        f = dict(v["fields"])
        lines += data(f"vec_chain_{i}", v["hex"])
        if "pulses" in f:
            lines += runs(f"vec_chain_runs_{i}", f["pulses"])
            f["run_count"] = len(f.pop("pulses"))
            f["runs"] = f"vec_chain_runs_{i}"
        if "data" in f:
            lines += data(f"vec_chain_data_{i}", f["data"])
            f["data_size"] = len(f["data"]) // 2
            f["data"] = f"vec_chain_data_{i}"
        if "memory" in f:
            f["memory"] = "PW_MEMORY_" + f["memory"]
        if "answer" in f:
            f["answer"] = "PW_END_" + f["answer"]
        if "firmware" in f:
            f["firmware"] = f"{{ {', '.join(map(str, f['firmware']))} }}"
        if "last" in f:
            f["last"] = int(f["last"])
        for name in ("checksum", "carried_out", "missed_commits", "damaged_messages"):
            if name in f:
                f[name] = u32(f[name])
        for name in ("period", "unique_id"):
            if name in f:
                f[name] = u64(f[name])
        head = {"name": quoted(v["name"]), "bytes": f"vec_chain_{i}", "size": len(v["hex"]) // 2}
        rows.append(fields(**head, end="PW_END_" + v["kind"], **f))
    return lines + table("vec_chain", "chain_messages", rows)


def refused_chain_messages(vectors: list[Case]) -> list[str]:
    """Messages that their receivers drop."""
    lines = ["struct vec_refused_chain { const char *name; const uint8_t *bytes; uint8_t size; };"]
    rows = []
    for i, v in enumerate(vectors):
        lines += data(f"vec_refused_chain_{i}", v["hex"])
        rows.append(f"{quoted(v['name'])}, vec_refused_chain_{i}, {len(v['hex']) // 2}")
    return lines + table("vec_refused_chain", "refused_chain_messages", rows)


def slices_and_commits(vectors: list[Case]) -> list[str]:
    """Whole slices and commits, with their route headers."""
    lines = ["struct vec_commit { const char *name; const uint8_t *slice; const uint8_t *commit; bool plays; };"]
    rows = []
    for i, v in enumerate(vectors):
        assert (len(v["slice"]), len(v["commit"])) == (2 * 51, 2 * 15)
        lines += data(f"vec_commit_slice_{i}", v["slice"]) + data(f"vec_commit_{i}", v["commit"])
        rows.append(f"{quoted(v['name'])}, vec_commit_slice_{i}, vec_commit_{i}, {str(v['plays']).lower()}")
    return lines + table("vec_commit", "slices_and_commits", rows)


def wirings(vectors: list[Case]) -> list[str]:
    """Of the answers, the wiring tables: for sorting."""
    lines = ["struct vec_wiring { const char *name; const uint16_t *channels; };"]
    rows = []
    for i, v in enumerate(v for v in vectors if v["request"] == "WIRING"):
        lines += array("uint16_t", f"vec_wiring_{i}", v["fields"]["channels"])
        rows.append(f"{quoted(v['name'])}, vec_wiring_{i}")
    return lines + table("vec_wiring", "wirings", rows)


def latin(text: str) -> list[int]:
    """The bytes of a line of text, of which a character stands for one byte."""
    return list(text.encode("latin-1"))


def frames(vectors: list[Case]) -> list[str]:
    """Frames, with what a REQUEST or a REPLY says."""
    lines = [
        "struct vec_frame {",
        "    const char *name;",
        "    const uint8_t *bytes, *body;",
        "    uint16_t size, body_size;",
        "    uint8_t kind, code;",
        "    bool to_device, to_host;",
        "    uint8_t tag, request_type, request, outcome;",
        "    uint16_t value, index, length;",
        "};",
    ]
    rows = []
    for i, v in enumerate(vectors):
        f = dict(v.get("fields", {}))
        f.pop("data", None)
        if "outcome" in f:
            f["outcome"] = "PW_" + f["outcome"]
        lines += data(f"vec_frame_{i}", v["hex"]) + data(f"vec_frame_body_{i}", v["body"])
        rows.append(
            fields(
                name=quoted(v["name"]),
                bytes=f"vec_frame_{i}",
                body=f"vec_frame_body_{i}",
                size=len(v["hex"]) // 2,
                body_size=len(v["body"]) // 2,
                kind="PW_FRAME_" + v["type"],
                code=v["code"],
                to_device="true" if v["goes"] in ("to the device", "both ways") else "false",
                to_host="true" if v["goes"] in ("to the host", "both ways") else "false",
                **f,
            )
        )
    return lines + table("vec_frame", "frames", rows)


def refused_frames(vectors: list[Case]) -> list[str]:
    """Damaged frames."""
    lines = ["struct vec_refused_frame { const char *name; const uint8_t *bytes; uint16_t size; };"]
    rows = []
    for i, v in enumerate(vectors):
        lines += data(f"vec_refused_frame_{i}", v["hex"])
        rows.append(f"{quoted(v['name'])}, vec_refused_frame_{i}, {len(v['hex']) // 2}")
    return lines + table("vec_refused_frame", "refused_frames", rows)


def streams(vectors: list[Case]) -> list[str]:
    """Bytes on a new line, and what they are, in order."""
    lines = [
        "enum vec_event_what { VEC_TEXT, VEC_FRAMES, VEC_CONSOLE, VEC_FRAME, VEC_DROPPED };",
        "struct vec_event { uint8_t what, kind; const uint8_t *bytes; uint16_t size; };",
        "struct vec_stream { const char *name; const uint8_t *bytes; uint16_t size, event_count;",
        "                    const struct vec_event *events; };",
    ]
    rows = []
    for i, v in enumerate(vectors):
        events = []
        for k, e in enumerate(v["events"]):
            content = e.get("text", e.get("body", ""))
            lines += data(f"vec_stream_{i}_{k}", content)
            what = {"text": "VEC_TEXT", "frame": "VEC_FRAME", "dropped": "VEC_DROPPED"}.get(next(iter(e)))
            kind = "PW_FRAME_" + e["frame"] if "frame" in e else "0"
            size = e.get("dropped", len(content) // 2)
            events.append(f"{what or 'VEC_' + e['mode']}, {kind}, vec_stream_{i}_{k}, {size}")
        lines += [f"static const struct vec_event vec_stream_events_{i}[] = {{", *(f"    {{ {e} }}," for e in events)]
        lines += ["};", *data(f"vec_stream_{i}", v["hex"])]
        sizes = f"{len(v['hex']) // 2}, {len(events)}"
        rows.append(f"{quoted(v['name'])}, vec_stream_{i}, {sizes}, vec_stream_events_{i}")
    return lines + table("vec_stream", "streams", rows)


def typing(vectors: list[Case]) -> list[str]:
    """What is typed, the lines that it makes, each with its size before it, and what is shown."""
    lines = [
        "struct vec_typing { const char *name; const uint8_t *typed, *shown, *lines; uint16_t typed_size, shown_size;",
        "                    uint8_t line_count; bool echo; };",
    ]
    rows = []
    for i, v in enumerate(vectors):
        made = [b for line in v["lines"] for b in (len(line), *latin(line))]
        lines += data(f"vec_typed_{i}", v["typed"]) + data(f"vec_shown_{i}", v["shown"])
        lines += array("uint8_t", f"vec_typed_lines_{i}", made)
        sizes = f"{len(v['typed']) // 2}, {len(v['shown']) // 2}, {len(v['lines'])}, {str(v['echo']).lower()}"
        rows.append(f"{quoted(v['name'])}, vec_typed_{i}, vec_shown_{i}, vec_typed_lines_{i}, {sizes}")
    return lines + table("vec_typing", "typings", rows)


def commands(vectors: list[Case]) -> list[str]:
    """Lines of a console; a command that is NULL is none, an argument of -1 too."""
    lines = [
        "struct vec_command { const char *name, *command; const uint8_t *line; uint8_t size, error, code;",
        "                     int32_t argument; };",
    ]
    rows = []
    for i, v in enumerate(vectors):
        lines += array("uint8_t", f"vec_command_{i}", latin(v["line"]))
        name = quoted(v["command"]) if v.get("command") is not None else "NULL"
        argument = -1 if v.get("argument") is None else v["argument"]
        error = f"PW_CONSOLE_{v['error']}" if "error" in v else "0"
        sizes = f"{len(v['line'])}, {error}, {v.get('code', 0)}, {argument}"
        rows.append(f"{quoted(v['name'])}, {name}, vec_command_{i}, {sizes}")
    return lines + table("vec_command", "commands", rows)


def exchanges(vectors: list[Case]) -> list[str]:
    """Lines of a console, and what the device sends after them."""
    lines = ["struct vec_exchange { const char *name, *line, *of; const uint8_t *answer; uint16_t size; };"]
    rows = []
    for i, v in enumerate(vectors):
        lines += array("uint8_t", f"vec_exchange_{i}", latin(v["answer"]))
        of = quoted(v["of"]) if "of" in v else "NULL"
        rows.append(f"{quoted(v['name'])}, {quoted(v['line'])}, {of}, vec_exchange_{i}, {len(v['answer'])}")
    return lines + table("vec_exchange", "exchanges", rows)


def console_data(vectors: list[Case]) -> list[str]:
    """Of the answers, those that the console shows as text."""
    lines = ["struct vec_console_datum { const char *name; const uint8_t *bytes; uint16_t size; };"]
    rows = []
    for i, v in enumerate(v for v in vectors if v["request"] in ("INFO", "CLOCK", "PROCESSORS")):
        lines += data(f"vec_console_datum_{i}", v["hex"])
        rows.append(f"{quoted(v['name'])}, vec_console_datum_{i}, {len(v['hex']) // 2}")
    return lines + table("vec_console_datum", "console_data", rows)


def image_case(i: int, part: str, v: Case) -> tuple[list[str], str]:
    """The bytes of an image or a file, and the beginning of its row."""
    name = f"vec_{part}_{i}"
    return data(name, v["hex"]), f"{quoted(v['name'])}, {name}, {len(v['hex']) // 2}"


def images(vectors: list[Case]) -> list[str]:
    """Valid firmware files, with their suffixes."""
    lines = [
        "struct vec_image { const char *name; const uint8_t *bytes; uint16_t size; uint8_t version[3], key_id[8]; };"
    ]
    rows = []
    for i, v in enumerate(vectors):
        assert v["reason"] == "ACCEPTED"
        array_lines, row = image_case(i, "image", v)
        lines += array_lines
        key_id = ", ".join(str(b) for b in bytes.fromhex(v["key_id"]))
        rows.append(f"{row}, {{ {', '.join(map(str, v['version']))} }}, {{ {key_id} }}")
    return lines + table("vec_image", "images", rows)


def refused_images(vectors: list[Case]) -> list[str]:
    """Files that are refused, and what GETSTATUS says of them."""
    lines = [
        "struct vec_refused_image { const char *name; const uint8_t *bytes; uint16_t size;",
        "                           uint8_t reason, code, dfu_status, dfu_string; };",
    ]
    rows = []
    for i, v in enumerate(vectors):
        array_lines, row = image_case(i, "refused_image", v)
        lines += array_lines
        codes = f"PW_IMAGE_{v['reason']}, {v['code']}, PW_DFU_{v['dfu_status']}, {v['dfu_string']}"
        rows.append(f"{row}, {codes}")
    return lines + table("vec_refused_image", "refused_images", rows)


def signatures(vectors: list[Case]) -> list[str]:
    """Images without suffix; whether a device that trusts the first one's key may store them."""
    lines = ["struct vec_signature { const char *name; const uint8_t *bytes; uint16_t size; bool trusted; };"]
    rows = []
    for i, v in enumerate(vectors):
        array_lines, row = image_case(i, "signature", v)
        lines += array_lines
        rows.append(f"{row}, {str(v['outcome'] == 'SIGNED').lower()}")
    return lines + table("vec_signature", "signatures", rows)


def boot_records(vectors: list[Case]) -> list[str]:
    """What stands at the beginning of a bank."""
    lines = [
        "struct vec_boot_record {",
        "    const char *name;",
        "    uint8_t bytes[56];",
        "    bool valid, may_boot;",
        "    uint32_t generation, size, started, confirmed;",
        "    uint8_t digest[32];",
        "};",
    ]
    rows = []
    for v in vectors:
        packed = ", ".join(str(b) for b in bytes.fromhex(v["hex"]))
        row = {"name": quoted(v["name"]), "bytes": f"{{ {packed} }}", "may_boot": str(v["may_boot"]).lower()}
        if v["fields"] is not None:
            f = v["fields"]
            row["valid"] = "true"
            row["digest"] = f"{{ {', '.join(str(b) for b in bytes.fromhex(f['digest']))} }}"
            row |= {name: f"{f[name]}u" for name in ("generation", "size", "started", "confirmed")}
        rows.append(fields(**row))
    return lines + table("vec_boot_record", "boot_records", rows)


def boot_orders(vectors: list[Case]) -> list[str]:
    """Names of records, and the banks that a loader tries."""
    lines = ["struct vec_boot_order { const char *name, *a, *b; uint8_t count, order[3]; };"]
    rows = []
    for v in vectors:
        banks = ", ".join(f"PW_BANK_{b}" for b in v["order"])
        rows.append(f"{quoted(v['name'])}, {quoted(v['a'])}, {quoted(v['b'])}, {len(v['order'])}, {{ {banks} }}")
    return lines + table("vec_boot_order", "boot_orders", rows)


def dfu_state(name: str) -> str:
    """PW_DFU_IDLE is the one whose name begins with DFU itself."""
    return "PW_DFU_" + name.removeprefix("DFU_")


def dfu_replies(vectors: list[Case]) -> list[str]:
    """Answers to GETSTATUS."""
    lines = ["struct vec_dfu_reply { const char *name; uint8_t bytes[6]; struct pw_dfu_reply fields; };"]
    rows = []
    for v in vectors:
        f = dict(v["fields"])
        f["status"], f["state"] = "PW_DFU_" + f["status"], dfu_state(f["state"])
        packed = ", ".join(str(b) for b in bytes.fromhex(v["hex"]))
        rows.append(f"{quoted(v['name'])}, {{ {packed} }}, {{ {fields(**f)} }}")
    return lines + table("vec_dfu_reply", "dfu_replies", rows)


def dfu_blocks(vectors: list[Case]) -> list[str]:
    """Blocks of a download; poll_ms 0 where nothing is written."""
    lines = [
        "struct vec_dfu_block { const char *name; uint32_t block, length, received, total; uint8_t status;",
        "                       uint32_t poll_ms; };",
    ]
    names = ("block", "length", "received", "total")
    rows = [
        f"{quoted(v['name'])}, {', '.join(str(v[n]) for n in names)}, PW_DFU_{v['status']}, {v['poll_ms'] or 0}"
        for v in vectors
    ]
    return lines + table("vec_dfu_block", "dfu_blocks", rows)


def dfu_transitions(vectors: list[Case]) -> list[str]:
    """The state that follows, and whether the request is answered with STALL."""
    lines = ["struct vec_dfu_transition { uint8_t state, event, next; bool stalls; };"]
    rows = [
        f"{dfu_state(v['state'])}, PW_DFU_ON_{v['event']}, {dfu_state(v['next'])}, {str(v['stalls']).lower()}"
        for v in vectors
    ]
    return lines + table("vec_dfu_transition", "dfu_transitions", rows)


def descriptors(vectors: list[Case]) -> list[str]:
    """Descriptors by speed and mode; no bytes are a STALL."""
    lines = [
        "struct vec_descriptor {",
        "    const char *name;",
        "    bool high_speed, dfu_mode;",
        "    uint8_t setup[8];",
        "    const uint8_t *bytes; /* NULL: STALL */",
        "    uint16_t size;",
        "};",
    ]
    modes = {
        "run time, high speed": "true, false",
        "run time, full speed": "false, false",
        "DFU mode": "true, true",
    }
    rows = []
    for i, v in enumerate(vectors):
        name, size = "NULL", 0
        if v["hex"] is not None:
            name, size = f"vec_descriptor_{i}", len(v["hex"]) // 2
            lines += data(name, v["hex"])
        setup = ", ".join(str(b) for b in bytes.fromhex(v["setup"]))
        rows.append(f"{quoted(v['name'])}, {modes[v['mode']]}, {{ {setup} }}, {name}, {size}")
    return lines + table("vec_descriptor", "descriptors", rows)


def setups(part: str, vectors: list[Case]) -> list[str]:
    """Rows of SETUP packets, and how many bytes answer them: -1 is a STALL."""
    rows = []
    for v in vectors:
        f = v["fields"]
        kind, _, unit = v["answer"].partition(" ")
        answer = int(kind) if unit == "bytes" else {"nothing": 0, "STALL": -1}[kind]
        setup = ", ".join(str(b) for b in bytes.fromhex(v["hex"]))
        numbers = f"{f['request_type']}, {f['request']}, {f['value']}, {f['index']}, {f['length']}"
        rows.append(f"{quoted(v['name'])}, {{ {setup} }}, {{ {numbers} }}, {answer}")
    return table("vec_setup", part, rows)


def requests(vectors: list[Case]) -> list[str]:
    """What the device answers."""
    lines = ["struct vec_setup { const char *name; uint8_t bytes[8]; uint16_t fields[5]; int answer; };"]
    return lines + setups("requests", vectors)


def refused_requests(vectors: list[Case]) -> list[str]:
    """What it answers with STALL."""
    return setups("refused_requests", vectors)


def packets(vectors: list[Case]) -> list[str]:
    """Packets on bulk IN, and the names of their records."""
    lines = [
        "struct vec_packet {",
        "    const char *name;",
        "    const uint8_t *bytes;",
        "    uint16_t size;",
        "    const char *const *records;",
        "    uint8_t record_count;",
        "};",
    ]
    rows = []
    for i, v in enumerate(vectors):
        lines += data(f"vec_packet_{i}", v["hex"])
        names = ", ".join(map(quoted, v["records"])) or "NULL"
        lines.append(f"static const char *const vec_packet_records_{i}[] = {{ {names} }};")
        size, count = len(v["hex"]) // 2, len(v["records"])
        rows.append(f"{quoted(v['name'])}, vec_packet_{i}, {size}, vec_packet_records_{i}, {count}")
    return lines + table("vec_packet", "packets", rows)


# Part of vectors.json, and who writes it. A part may stand here more than once.
PARTS: list[tuple[str, Callable[[list[Case]], list[str]]]] = [
    ("pulse_pairs", pulse_pairs),
    ("modulated_widths", modulated_widths),
    ("powers", powers),
    ("blocks", blocks),
    ("refused_blocks", refused_blocks),
    ("records", records),
    ("device_transitions", device_transitions),
    ("chain_messages", chain_messages),
    ("refused_chain_messages", refused_chain_messages),
    ("slices_and_commits", slices_and_commits),
    ("answers", wirings),
    ("frames", frames),
    ("refused_frames", refused_frames),
    ("streams", streams),
    ("typing", typing),
    ("commands", commands),
    ("exchanges", exchanges),
    ("answers", console_data),
    # FWU, DFU:
    ("images", images),
    ("refused_images", refused_images),
    ("signatures", signatures),
    ("boot_records", boot_records),
    ("boot_orders", boot_orders),
    ("dfu_replies", dfu_replies),
    ("dfu_blocks", dfu_blocks),
    ("dfu_transitions", dfu_transitions),
    # USB, REQ:
    ("descriptors", descriptors),
    ("requests", requests),
    ("refused_requests", refused_requests),
    ("packets", packets),
]


def main(source: str, target: str) -> None:
    """Write all parts."""
    vectors = json.loads(Path(source).read_text(encoding="utf-8"))
    assert vectors["format"] == "phasewire-vectors-1"
    lines = [
        "/* Made by vectors_to_c.py from protocol/vectors.json. Do not edit. */",
        "#ifndef VECTORS_H",
        "#define VECTORS_H",
        "",
        '#include "ack.h"',
        '#include "bytes.h"',
        '#include "codes.h"',
        '#include "dfu.h"',
        "",
        "#define VEC_COUNT(table) (sizeof(table) / sizeof((table)[0]))",
    ]
    for part, write in PARTS:
        lines += ["", f"/* {part} */", *write(vectors[part]["vectors"])]
    lines += ["", "#endif", ""]
    Path(target).write_text("\n".join(lines), encoding="ascii")


if __name__ == "__main__":
    main(*sys.argv[1:])
