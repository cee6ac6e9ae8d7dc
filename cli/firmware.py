"""Commands for firmware images as files: ``firmware build``, ``inspect``, ``sign`` and ``verify``.

No device is needed for any of them; ``flash`` sends an image to one.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.table import Column, Table

from ..base.errors import InputFileError
from ..base.signals import loading
from ..base.storage import check_outputs, write_file
from ..base.storage import read_file as read_bounded
from ..host.firmware.images import read_file, read_image
from ..host.firmware.keys import (
    MAKE_PRIVATE_KEY,
    MAKE_PUBLIC_KEY,
    exposure,
    judge,
    judge_file,
    read_private_key,
    read_public_keys,
)
from ..protocol.board import PROCESSORS
from ..protocol.codes import SEGMENT_MAX_BYTES, Hardware, Target
from ..protocol.enumeration import PRODUCT_ID, VENDOR_ID
from ..protocol.firmware import Image, ImageHeader, Segment, Suffix, sign, with_suffix
from ..protocol.versions import Version
from .console import JsonOption, console_for, error_console, print_list, write_json

if TYPE_CHECKING:
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

__all__ = ["commands"]

commands = typer.Typer(
    rich_markup_mode=None,
    no_args_is_help=True,
    help="Build, inspect, sign and verify firmware images.",
    epilog=f"A key to sign with: {MAKE_PRIVATE_KEY}. The key to verify with: {MAKE_PUBLIC_KEY}.",
)

ANY, ANY_ID = "any", 0xFFFF

FileArgument = Annotated[Path, typer.Argument(metavar="FILE", help="A firmware image, with its DFU suffix.")]
OutputOption = Annotated[Path, typer.Option("--output", "-o", metavar="FILE", help="The .dfu file to write.")]
KEY_HELP = f"PEM file of the private key, not encrypted. Make one by: {MAKE_PRIVATE_KEY}."
PUBLIC_KEY_HELP = f"PEM file of a trusted public key; may be given again. Make one by: {MAKE_PUBLIC_KEY}."


@commands.command(
    epilog="Example: phasewire firmware build --controller c.bin --processors p.bin --firmware-version 1.2.3 -o new.dfu"
)
def build(
    firmware_version: Annotated[str, typer.Option(metavar="X.Y.Z", help="Version of the firmware, up to 99.9.9.")],
    output: OutputOption,
    controller: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="The controller's program; by default the emulator's, which only stands for one.",
        ),
    ] = None,
    processors: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="The program of all ten processors, if they are alike; by default the one of this package.",
        ),
    ] = None,
    processor: Annotated[
        list[str] | None,
        typer.Option(metavar="N=FILE", help="The program of processor N, 0 to 9; ten of these if they differ."),
    ] = None,
    hardware: Annotated[
        str, typer.Option(metavar="NAME", help=f"The target hardware: {', '.join(kind.name for kind in Hardware)}.")
    ] = Hardware.FIVE_BOARDS.name,
    usb_id: Annotated[
        str,
        typer.Option(
            metavar="VENDOR:PRODUCT",
            help="USB id of the devices that take the file, in hexadecimal; any:any for all.",
        ),
    ] = f"{VENDOR_ID:04x}:{PRODUCT_ID:04x}",
    key: Annotated[Path | None, typer.Option(metavar="PRIVATE.pem", help=f"Sign the image at once. {KEY_HELP}")] = None,
    json_target: JsonOption = None,
) -> None:
    """Put the programs of controller and processors into one image, which phasewire flash and dfu-util take.

    A program has 1 to 65536 bytes, the size of a processor's memory; its contents are not checked.
    """
    programs = _programs(processors, processor or [])
    if controller is not None:
        programs[Target.CONTROLLER] = controller
    check_outputs([output, json_target], [*programs.values(), *([key] if key else [])])
    version, (vendor, product) = _version(firmware_version), _usb_id(usb_id)
    segments = [_segment(target, path) for target, path in programs.items()]
    image = Image(version, _completed(segments, version), _hardware(hardware))
    if key:
        image = sign(image, _private_key(key))
    _write(output, image, Suffix(vendor, product, version.bcd), json_target)


@commands.command(epilog="Example: phasewire firmware inspect new.dfu")
def inspect(
    file: FileArgument,
    key: Annotated[
        list[Path] | None, typer.Option(metavar="PUBLIC.pem", help=f"Check the signature. {PUBLIC_KEY_HELP}")
    ] = None,
    json_target: JsonOption = None,
) -> None:
    """Show what a firmware image contains, its target hardware, and who signed it."""
    check_outputs([json_target], [file, *(key or [])])
    image, suffix = read_image(file)
    verdict = judge(image, read_public_keys(key or []))
    header = ImageHeader.decode(image.encode())
    summary = Table(title=str(file), show_header=False, title_justify="left")
    for label, value in (
        ("firmware", str(image.version)),
        ("hardware", image.hardware.name),
        ("protocol", f"version {image.protocol}"),
        ("image", f"{header.total} bytes"),
        ("signature", verdict.words),
        ("for USB devices", f"{_id_text(suffix.vendor)}:{_id_text(suffix.product)}"),
        ("release", _id_text(suffix.release)),
    ):
        summary.add_row(label, value)
    segments = Table("target", Column("bytes", justify="right"), "CRC-32", "SHA-256")
    for entry in header.entries:
        segments.add_row(Target(entry.target).name, str(entry.size), f"{entry.checksum:08x}", entry.digest.hex())
    out = console_for(json_target)
    out.print(summary)
    print_list(out, segments, "CRC-32", "SHA-256")
    write_json(json_target, _record(file, image, suffix) | {"signature": verdict._asdict()})


@commands.command(name="sign", epilog="Example: phasewire firmware sign new.dfu --key key.pem -o signed.dfu")
def sign_file(
    file: FileArgument,
    key: Annotated[Path, typer.Option(metavar="PRIVATE.pem", help=KEY_HELP)],
    output: OutputOption,
    json_target: JsonOption = None,
) -> None:
    """Sign a firmware image; an old signature is replaced, and nothing else changes."""
    check_outputs([output, json_target], [file, key])
    image, suffix = read_image(file)
    _write(output, sign(image, _private_key(key)), suffix, json_target)


@commands.command(epilog="Example: phasewire firmware verify signed.dfu --key public.pem")
def verify(
    file: FileArgument,
    key: Annotated[list[Path], typer.Option(metavar="PUBLIC.pem", help=PUBLIC_KEY_HELP)],
    json_target: JsonOption = None,
) -> None:
    """Check that a firmware image is undamaged and signed with a trusted key.

    The exit code is 0 if it is and 1 if it is not.
    """
    check_outputs([json_target], [file, *key])
    verdict = judge_file(read_file(file), read_public_keys(key))
    style = "bold green" if verdict.trusted else "bold red"
    console_for(json_target).print(f"{file}: {verdict.outcome}: {verdict.words}", style=style)
    told = {"format": "phasewire-firmware-verify-1", "file": str(file), "trusted": verdict.trusted}
    write_json(json_target, told | verdict._asdict())
    if not verdict.trusted:
        raise typer.Exit(1)


# Values of options


def _programs(processors: Path | None, each: Sequence[str]) -> dict[Target, Path]:
    """The files of the processors' programs, in the order of clause FWU-007; none means the package's own program."""
    if processors is not None and each:
        raise ValueError(
            f"name the processors' programs once: --processors FILE, or --processor N=FILE {PROCESSORS} times"
        )
    if processors is not None:
        return {Target.ALL_PROCESSORS: processors}
    if not each:
        return {}
    named: dict[int, Path] = {}
    for text in each:
        number, equals, path = text.partition("=")
        if not (equals and path and number in map(str, range(PROCESSORS))):
            raise ValueError(f"--processor {text}: write N=FILE, with N from 0 to {PROCESSORS - 1}")
        if int(number) in named:
            raise ValueError(f"--processor {text}: processor {number} has a program already, {named[int(number)]}")
        named[int(number)] = Path(path)
    if missing := [n for n in range(PROCESSORS) if n not in named]:
        raise ValueError(
            f"no program for processor {', '.join(map(str, missing))}; name one for each, or --processors for all"
        )
    return {Target(n): named[n] for n in range(PROCESSORS)}


def _version(text: str) -> Version:
    if not re.fullmatch(r"\d{1,9}\.\d{1,9}\.\d{1,9}", text, re.ASCII):
        raise ValueError(f"--firmware-version {text}: write three numbers with dots between them, such as 1.2.3")
    return Version(*map(int, text.split(".")))


def _hardware(name: str) -> Hardware:
    if name not in Hardware.__members__:
        raise ValueError(f"unknown hardware {name!r}; known are {', '.join(Hardware.__members__)}")
    return Hardware[name]


def _usb_id(text: str) -> tuple[int, int]:
    halves = text.split(":")
    if len(halves) != 2 or not all(re.fullmatch(rf"[0-9a-fA-F]{{4}}|{ANY}", half) for half in halves):
        raise ValueError(
            f"--usb-id {text}: write vendor and product in four hexadecimal digits each, such as 1209:0001, or {ANY}"
        )
    vendor, product = (ANY_ID if half == ANY else int(half, 16) for half in halves)
    return vendor, product


def _id_text(number: int) -> str:
    return ANY if number == ANY_ID else f"{number:04x}"


# Files


def _private_key(path: Path) -> Ed25519PrivateKey:
    """A key to sign with; warns if others can read it too."""
    key = read_private_key(path)
    if problem := exposure(path):
        error_console().print(f"warning: {problem}", style="yellow")
    return key


def _segment(target: Target, path: Path) -> Segment:
    data = read_bounded(path, SEGMENT_MAX_BYTES)
    if not data:
        raise InputFileError(f"{path} is empty; the program for {target.name} must have 1 to {SEGMENT_MAX_BYTES} bytes")
    return Segment(target, data)


def _completed(given: Sequence[Segment], version: Version) -> tuple[Segment, ...]:
    """The segments of an image: those given, and the package's own in place of missing ones."""
    if {segment.target is Target.CONTROLLER for segment in given} == {False, True}:
        return tuple(given)
    with loading():
        from ..emulator.firmware.loader import FACTORY_IMAGE  # slow, and only for what is missing
        from ..firmware.xmos.build import processor_segment
    segments = list(given)
    if not any(segment.target is not Target.CONTROLLER for segment in segments):
        segments.insert(0, Segment(Target.ALL_PROCESSORS, processor_segment(version)))
    if not any(segment.target is Target.CONTROLLER for segment in segments):
        segments += (segment for segment in FACTORY_IMAGE.segments if segment.target is Target.CONTROLLER)
    return tuple(segments)


def _write(path: Path, image: Image, suffix: Suffix, json_target: str | None) -> None:
    write_file(path, with_suffix(image.encode(), suffix))
    by = "not signed" if image.signature is None else f"signed with key {image.signature.key_id.hex()}"
    console_for(json_target).print(f"{path}: firmware {image.version} for {image.hardware.name}, {by}")
    write_json(json_target, _record(path, image, suffix))


def _record(path: Path, image: Image, suffix: Suffix) -> dict[str, Any]:
    header = ImageHeader.decode(image.encode())
    return {
        "format": "phasewire-firmware-image-1",
        "file": str(path),
        "version": str(image.version),
        "hardware": image.hardware.name,
        "protocol": image.protocol,
        "bytes": header.total,
        "key_id": None if image.signature is None else image.signature.key_id.hex(),
        "suffix": {name: _id_text(number) for name, number in suffix._asdict().items()},
        "segments": [
            {
                "target": Target(entry.target).name,
                "bytes": entry.size,
                "crc32": f"{entry.checksum:08x}",
                "sha256": entry.digest.hex(),
            }
            for entry in header.entries
        ],
    }
