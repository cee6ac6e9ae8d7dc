"""``phasewire firmware``: its files, its output, and wrong use."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from functools import partial
from pathlib import Path

import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat, PublicFormat
from phasewire.emulator.firmware.loader import FACTORY_IMAGE
from phasewire.firmware.xmos.build import processor_segment
from phasewire.protocol.codes import Target
from phasewire.protocol.firmware import Segment, Suffix, parse, with_suffix
from phasewire.protocol.versions import Version

from tests.cli.runner import Run
from tests.specification import hex_examples

EXAMPLE = hex_examples()["IMAGE_FILE"]  # signed with the first key of RFC 8032, section 7.1
KEY = Ed25519PrivateKey.from_private_bytes(
    bytes.fromhex("9d61b19deffd5a60ba844af492ec2cc44449c5697b326919703bac031cae7f60")
)
STRANGER = Ed25519PrivateKey.from_private_bytes(bytes(range(32)))
KEY_ID = "21fe31dfa154a261"
PROCESSORS, CONTROLLER = bytes([1, 2, 3, 4, 5]), bytes([0xAA, 0xBB, 0xCC, 0xDD])
ALIKE = ("--controller", "controller.bin", "--processors", "processors.bin")
TO_BUILD = ("build", *ALIKE, "--firmware-version", "1.2.3", "-o", "image.dfu")


def public_pem(key: Ed25519PrivateKey) -> bytes:
    return key.public_key().public_bytes(Encoding.PEM, PublicFormat.SubjectPublicKeyInfo)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with programs and keys, in which commands run."""
    for name, data in {
        "processors.bin": PROCESSORS,
        "controller.bin": CONTROLLER,
        "key.pem": KEY.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption()),
        "public.pem": public_pem(KEY),
        "stranger.pem": public_pem(STRANGER),
        "signed.dfu": EXAMPLE,
        **{f"{n}.bin": bytes([n]) * (n + 1) for n in range(10)},
    }.items():
        (tmp_path / name).write_bytes(data)
    (tmp_path / "key.pem").chmod(0o600)
    return tmp_path


@pytest.fixture
def firmware(folder: Path, phasewire: Run) -> Run:
    return partial(phasewire, "firmware")


# Building and signing


def test_build_makes_the_specification_s_example(firmware: Run, folder: Path) -> None:
    outcome = firmware(*TO_BUILD, "--key", "key.pem")
    assert outcome == (0, f"image.dfu: firmware 1.2.3 for FIVE_BOARDS, signed with key {KEY_ID}\n", "")
    assert (folder / "image.dfu").read_bytes() == EXAMPLE


def test_an_image_signed_later_is_the_same(firmware: Run, folder: Path) -> None:
    assert firmware(*TO_BUILD).out.endswith("not signed\n")
    assert (folder / "image.dfu").read_bytes() != EXAMPLE
    assert firmware("sign", "image.dfu", "--key", "key.pem", "-o", "later.dfu").code == 0
    assert (folder / "later.dfu").read_bytes() == EXAMPLE


def test_sign_replaces_only_the_signature(firmware: Run, folder: Path) -> None:
    (folder / "other.pem").write_bytes(STRANGER.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption()))
    assert firmware(*TO_BUILD, "--usb-id", "any:beef").code == 0
    for source, key, target in (("image.dfu", "other.pem", "once.dfu"), ("once.dfu", "key.pem", "twice.dfu")):
        assert firmware("sign", source, "--key", key, "-o", target).code == 0
    twice = (folder / "twice.dfu").read_bytes()
    assert twice[:-16] == EXAMPLE[:-16]
    assert twice[-16:-4].hex() == "2301efbeffff000155464410"
    assert firmware("verify", "once.dfu", "--key", "stranger.pem").code == 0


def test_each_processor_may_have_its_own_program(firmware: Run, folder: Path) -> None:
    each = [f"--processor={n}={n}.bin" for n in reversed(range(10))]
    outcome = firmware(
        "build", "--controller", "controller.bin", *each, "--firmware-version", "99.9.0", "-o", "ten.dfu", "--json", "-"
    )
    record = json.loads(outcome.out)
    assert (record["version"], record["suffix"]["release"], record["key_id"]) == ("99.9.0", "9990", None)
    assert [segment["target"] for segment in record["segments"]] == [
        *(f"PROCESSOR_{n}" for n in range(10)),
        "CONTROLLER",
    ]
    assert [segment["bytes"] for segment in record["segments"]] == [*range(1, 11), 4]
    image = parse((folder / "ten.dfu").read_bytes())
    assert [segment.data for segment in image.segments] == [bytes([n]) * (n + 1) for n in range(10)] + [CONTROLLER]


def test_missing_programs_are_the_package_s_own(firmware: Run, folder: Path) -> None:
    """The processors' program executes; the controller's only stands for one."""
    version = Version(2, 3, 4)
    outcome = firmware("build", "--firmware-version", "2.3.4", "-o", "own.dfu")
    assert outcome.code == 0, outcome.err
    image = parse((folder / "own.dfu").read_bytes())
    processors, controller = image.segments
    assert (processors.target, processors.data) == (Target.ALL_PROCESSORS, processor_segment(version))
    assert controller == FACTORY_IMAGE.segments[-1]
    assert controller.target is Target.CONTROLLER
    each = [f"--processor={n}={n}.bin" for n in range(10)]
    for given, segments in (
        (["--controller", "controller.bin"], (processors, Segment(Target.CONTROLLER, CONTROLLER))),
        (["--processors", "processors.bin"], (Segment(Target.ALL_PROCESSORS, PROCESSORS), controller)),
        (each, (*(Segment(Target(n), bytes([n]) * (n + 1)) for n in range(10)), controller)),
    ):
        assert firmware("build", "--firmware-version", "2.3.4", *given, "-o", "own.dfu").code == 0
        assert parse((folder / "own.dfu").read_bytes()).segments == segments


# Looking


def forged() -> bytes:
    """The example with a signature that is wrong, and a suffix that is right."""
    return with_suffix(EXAMPLE[:140] + bytes(64), Suffix(0x1209, 1, 0x123))


def test_the_four_outcomes_of_a_signature_are_distinguished(firmware: Run, folder: Path) -> None:
    """Clause FWU-012."""
    (folder / "forged.dfu").write_bytes(forged())
    firmware(*TO_BUILD)
    cases = {
        ("signed.dfu", "public.pem"): ("SIGNED", 0),
        ("signed.dfu", "stranger.pem"): ("UNKNOWN_KEY", 1),
        ("image.dfu", "public.pem"): ("UNSIGNED", 1),
        ("forged.dfu", "public.pem"): ("SIGNATURE", 1),
    }
    for (file, key), (outcome, code) in cases.items():
        said = firmware("inspect", file, "--key", key, "--json", "-")
        assert (said.code, json.loads(said.out)["signature"]["outcome"]) == (0, outcome)
        said = firmware("verify", file, "--key", key)
        assert (said.code, said.err) == (code, "")
        assert said.out.startswith(f"{file}: {outcome}: ")
    assert firmware("verify", "signed.dfu", "--key", "stranger.pem", "--key", "public.pem").code == 0
    assert KEY_ID in firmware("inspect", "signed.dfu").out


def test_verify_names_the_reason_of_an_image_that_is_not_valid(firmware: Run, folder: Path) -> None:
    (folder / "bad.dfu").write_bytes(EXAMPLE[:-1])
    outcome = firmware("verify", "bad.dfu", "--key", "public.pem", "--json", "-")
    record = json.loads(outcome.out)
    assert (outcome.code, record["trusted"], record["outcome"]) == (1, False, "SUFFIX")
    assert "clause FWU-014" in record["words"]


# Other programs


@pytest.mark.skipif(shutil.which("openssl") is None, reason="openssl is not installed")
def test_openssl_verifies_the_signature(firmware: Run, folder: Path) -> None:
    (folder / "processors.bin").write_bytes(bytes(range(256)) * 256)
    assert firmware(*TO_BUILD, "--key", "key.pem").code == 0
    image = (folder / "image.dfu").read_bytes()[:-16]
    (folder / "covered").write_bytes(image[:-64])
    (folder / "signature").write_bytes(image[-64:])
    verified = subprocess.run(
        [
            *("openssl", "pkeyutl", "-verify", "-pubin", "-inkey", "public.pem", "-rawin", "-in", "covered"),
            "-sigfile",
            "signature",
        ],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=30,
        check=True,
    )
    assert "Signature Verified Successfully" in verified.stdout


@pytest.mark.skipif(shutil.which("dfu-suffix") is None, reason="dfu-util is not installed")
def test_dfu_suffix_reads_the_suffix(firmware: Run, folder: Path) -> None:
    assert firmware(*TO_BUILD, "--usb-id", "1d50:any").code == 0
    checked = subprocess.run(
        ["dfu-suffix", "-c", "image.dfu"], cwd=folder, capture_output=True, text=True, timeout=30, check=True
    )
    said = [line.split() for line in checked.stdout.lower().splitlines()]
    for found in (["bcd", "device:", "0x0123"], ["product", "id:", "0xffff"], ["vendor", "id:", "0x1d50"]):
        assert found in said


@pytest.mark.skipif(shutil.which("openssl") is None, reason="openssl is not installed")
@pytest.mark.slow
def test_the_commands_of_the_document_run(tmp_path: Path) -> None:
    document = (Path(__file__).parents[2] / "docs" / "how-to/firmware.md").read_text(encoding="utf-8")
    script = "\n".join(re.findall(r"^```sh\n(.*?)^```", document, re.MULTILINE | re.DOTALL))
    ended = subprocess.run(
        ["bash", "-euc", f'phasewire() {{ "{sys.executable}" -m phasewire "$@"; }}\n{script}'],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    )
    assert ended.stdout.splitlines()[-1].startswith("signed.dfu: SIGNED: ")


# Wrong use


def build_with(*arguments: str) -> tuple[str, ...]:
    return ("build", *arguments, "-o", "image.dfu")


VERSION = ("--firmware-version", "1.2.3")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (build_with(*ALIKE, "--firmware-version", "1.2"), "write three numbers with dots between them, such as 1.2.3"),
        (build_with(*ALIKE, "--firmware-version", "1.2.-3"), "write three numbers"),
        (build_with(*ALIKE, "--firmware-version", "1.2.10"), "1.2.10: the first number is 0 to 99, the others 0 to 9"),
        (build_with(*ALIKE, "--firmware-version", "100.0.0"), "100.0.0: the first number is 0 to 99"),
        (build_with(*ALIKE, *VERSION, "--hardware", "SIX"), "unknown hardware 'SIX'; known are FIVE_BOARDS"),
        (build_with(*ALIKE, *VERSION, "--usb-id", "1209"), "such as 1209:0001, or any"),
        (build_with(*ALIKE, *VERSION, "--usb-id", "1209:00001"), "four hexadecimal digits"),
        (build_with(*ALIKE, *VERSION, "--key", "public.pem"), "public.pem holds a public key"),
        (build_with(*ALIKE, *VERSION, "--key", "none.pem"), "none.pem: No such file"),
        (build_with(*ALIKE, *VERSION, "--processor", "0=0.bin"), "programs once: --processors"),
        (
            build_with(*ALIKE, *VERSION, *(f"--processor={n}={n}.bin" for n in range(10))),
            "programs once: --processors FILE, or --processor N=FILE 10 times",
        ),
        (build_with("--firmware-version", "1.2.10"), "1.2.10: the first number is 0 to 99, the others 0 to 9"),
        (build_with(*ALIKE[:2], *VERSION, "--processor", "10=0.bin"), "N=FILE, with N from 0 to 9"),
        (build_with(*ALIKE[:2], *VERSION, "--processor", "0.bin"), "N=FILE, with N from 0 to 9"),
        (build_with(*ALIKE[:2], *VERSION, "--processor", "³=0.bin"), "N=FILE, with N from 0 to 9"),
        (
            build_with(*ALIKE[:2], *VERSION, *(f"--processor={n}={n}.bin" for n in range(8))),
            "no program for processor 8, 9; name one for each, or --processors for all",
        ),
        (
            build_with(*ALIKE[:2], *VERSION, "--processor=1=1.bin", "--processor=1=2.bin"),
            "processor 1 has a program already, 1.bin",
        ),
        (
            build_with("--controller", "empty.bin", *ALIKE[2:], *VERSION),
            "empty.bin is empty; the program for CONTROLLER",
        ),
        (
            build_with("--controller", "large.bin", *ALIKE[2:], *VERSION),
            "large.bin has 65537 bytes; such a file",
        ),
        (build_with("--controller", "none.bin", *ALIKE[2:], *VERSION), "none.bin: No such file"),
        (("build", *ALIKE, *VERSION, "-o", "controller.bin"), "controller.bin cannot be written: it is also what is"),
        (("build", *ALIKE, *VERSION, "-o", "nowhere/image.dfu"), "no folder nowhere"),
        (("sign", "signed.dfu", "--key", "key.pem", "-o", "signed.dfu"), "it is also what is read"),
        (
            ("sign", "key.pem", "--key", "key.pem", "-o", "image.dfu"),
            "key.pem: SUFFIX: the file does not end with a DFU",
        ),
        (("sign", "signed.dfu", "--key", "signed.dfu", "-o", "image.dfu"), "signed.dfu holds no private key in PEM"),
        (("inspect", "empty.bin"), "empty.bin: SUFFIX"),
        (("inspect", "none.dfu"), "none.dfu: No such file"),
        (("verify", "none.dfu", "--key", "public.pem"), "none.dfu: No such file"),
        (("verify", "signed.dfu", "--key", "key.pem"), "key.pem holds a private key; its public half is enough"),
        (("verify", "signed.dfu"), "Missing option '--key'"),
    ],
)
def test_wrong_use_is_refused_and_changes_no_file(
    firmware: Run, folder: Path, arguments: tuple[str, ...], said: str
) -> None:
    (folder / "empty.bin").write_bytes(b"")
    (folder / "large.bin").write_bytes(bytes(65_537))
    (folder / "image.dfu").write_bytes(b"what stood here")
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    outcome = firmware(*arguments)
    assert (outcome.code, outcome.out) == (2, "")
    assert said in " ".join(outcome.err.split())
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before


def test_an_image_is_written_whole_or_not_at_all(firmware: Run, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(self: Path, data: bytes) -> int:
        with self.open("wb") as file:
            file.write(data[:50])
        raise OSError(28, "No space left on device", str(self))

    before = {path.name for path in folder.iterdir()}
    monkeypatch.setattr(Path, "write_bytes", full)
    assert firmware(*TO_BUILD).code == 2
    assert {path.name for path in folder.iterdir()} == before


def test_a_private_key_readable_by_others_gives_a_warning(firmware: Run, folder: Path) -> None:
    (folder / "key.pem").chmod(0o640)
    outcome = firmware(*TO_BUILD, "--key", "key.pem")
    said = "warning: key.pem can be used by others than its owner (mode 0640), who can sign firmware with it; "
    assert (outcome.code, " ".join(outcome.err.split())) == (0, f"{said}mend it by: chmod 600 key.pem")
