"""``phasewire flash``: its output, its exit codes, and the device after it."""

from __future__ import annotations

import json
import re
import shlex
import shutil
import subprocess
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import pytest
from cryptography.hazmat.primitives.asymmetric.ec import SECP256R1, generate_private_key
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.hazmat.primitives.serialization import Encoding, PublicFormat
from phasewire import Emulator, open_device
from phasewire.__main__ import main
from phasewire.emulator import faults
from phasewire.protocol.codes import Bank
from phasewire.protocol.firmware import build

from tests.cli.runner import Run
from tests.host.upgrades import (
    FACTORY,
    FILE,
    KEY,
    NEW,
    OLD,
    STRANGER,
    in_dfu_mode,
    running,
    trusting,
    untouched,
)

GUIDE = (Path(__file__).parents[2] / "docs" / "how-to/flashing.md").read_text(encoding="utf-8")


@pytest.fixture
def phasewire(phasewire: Run, emulator: Emulator, monkeypatch: pytest.MonkeyPatch) -> Run:
    """Run ``phasewire flash`` on an emulated device, in a folder with images and keys."""
    monkeypatch.setenv("PHASEWIRE_DEVICE", emulator.url)
    for name, content in (
        ("new.dfu", FILE),
        ("old.dfu", build(OLD)),
        ("signed.dfu", build(NEW, KEY)),
        ("bad.dfu", FILE[:3000] + b"?" + FILE[3001:]),
        ("key.pem", public(KEY)),
        ("stranger.pem", public(STRANGER)),
        ("other.pem", generate_private_key(SECP256R1()).public_key().public_bytes(Encoding.PEM, SPKI)),
    ):
        Path(name).write_bytes(content)
    return partial(phasewire, "flash")


SPKI = PublicFormat.SubjectPublicKeyInfo


def public(key: Ed25519PrivateKey) -> bytes:
    return key.public_key().public_bytes(Encoding.PEM, SPKI)


def test_an_image_is_flashed_and_the_steps_are_printed(phasewire: Run, emulator: Emulator) -> None:
    outcome = phasewire("new.dfu", "--json", "flash.json")
    assert outcome.code == 0
    assert outcome.out == (
        f"phasewire five-board array (emulated) {emulator.serial} was given firmware 2.3.4, which runs on all eleven "
        "processors, from bank A; before it ran 0.1.0.\n"
    )
    assert outcome.err.splitlines() == [
        "new.dfu: firmware 2.3.4, not signed",
        "going to DFU mode",
        "comparing with what it holds",
        "writing",
        "reading back",
        "starting the new firmware",
    ]
    record = json.loads(Path("flash.json").read_text())
    assert record.pop("device").endswith(emulator.serial)
    assert record == {
        "format": "phasewire-flash-1",
        "before": "0.1.0",
        "firmware": "2.3.4",
        "bank": "A",
        "trust": "UNSIGNED",
        "written": True,
        "attempts": 1,
    }
    assert running(emulator) == (NEW.version, Bank.A)
    outcome = phasewire("new.dfu", "--json", "-")
    assert json.loads(outcome.out)["written"] is False
    assert "held firmware 2.3.4 already" in outcome.err


def test_a_terminal_shows_a_bar(phasewire: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FORCE_COLOR", "1")
    outcome = phasewire("new.dfu")
    assert outcome.code == 0
    assert "starting the new firmware" in outcome.err
    assert "\x1b" in outcome.err
    assert "━" in outcome.err


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        (("bad.dfu",), 2, "bad.dfu: SUFFIX: the file does not end with a DFU suffix that is right (clause FWU-014)"),
        (("key.pem",), 2, "(clause FWU-014)"),
        (("missing.dfu",), 2, "'missing.dfu' does not exist"),
        (("new.dfu", "--key", "key.pem"), 2, "the image is not signed, and 1 trusted key(s) were given"),
        (("signed.dfu", "--key", "stranger.pem"), 2, "signed with a key that is not trusted"),
        (("signed.dfu", "--key", "other.pem"), 2, "other.pem holds a key of another kind"),
        (("signed.dfu", "--key", "new.dfu"), 2, "new.dfu holds no public key in PEM"),
        (("new.dfu", "--device", "emulator:NOBODY"), 3, "no device at 'emulator:NOBODY'"),
        (("new.dfu", "--device", "serial:///dev/ttyACM0"), 3, "firmware goes over USB"),
        ((), 2, "Give one of IMAGE, --list and --revert"),
        (("new.dfu", "--list"), 2, "Give one of IMAGE, --list and --revert"),
        (("--list", "--key", "key.pem"), 2, "have no effect without IMAGE"),
        (("--revert", "--allow-downgrade"), 2, "have no effect without IMAGE"),
        (("new.dfu", "--json", "new.dfu"), 2, "new.dfu cannot be written: it is also what is read"),
    ],
)
def test_a_refused_image_leaves_the_device_unchanged(
    phasewire: Run, emulator: Emulator, arguments: tuple[str, ...], code: int, message: str
) -> None:
    outcome = phasewire(*arguments)
    assert (outcome.code, outcome.out) == (code, "")
    assert message in " ".join(outcome.err.split())
    assert "Traceback" not in outcome.err
    assert untouched(emulator)


def test_an_older_image_needs_an_option(phasewire: Run, emulator: Emulator) -> None:
    assert phasewire("new.dfu").code == 0
    outcome = phasewire("old.dfu")
    assert (outcome.code, running(emulator)[0]) == (2, NEW.version)
    assert "allow the downgrade (--allow-downgrade)" in outcome.err
    assert phasewire("old.dfu", "--allow-downgrade").code == 0
    assert running(emulator)[0] == OLD.version


@pytest.fixture
def strict() -> Iterator[Emulator]:
    with Emulator(flash=trusting(KEY)) as emulator:
        yield emulator


def test_a_device_that_refuses_an_image_is_code_4(phasewire: Run, strict: Emulator) -> None:
    outcome = phasewire("new.dfu", "--device", strict.url)
    assert outcome.code == 4
    assert "refuses the image: the signature is wrong, or the device does not trust who signed" in outcome.err
    assert not in_dfu_mode(strict)
    strict.run_until_started()
    assert strict.running.info().firmware == FACTORY


def test_a_device_that_is_lost_is_code_4(phasewire: Run, emulator: Emulator) -> None:
    emulator.inject(faults.PowerCutInWrite(written_bytes=10_000))
    outcome = phasewire("new.dfu")
    assert outcome.code == 4
    assert "switch it off and on, and look at its cable. It boots its old firmware, or the new one" in outcome.err


def test_ctrl_c_prints_the_next_step(phasewire: Run, emulator: Emulator, monkeypatch: pytest.MonkeyPatch) -> None:
    genuine = emulator.flash.program

    def program(address: int, data: bytes) -> None:
        if address == Bank.A.image_address + 4096:
            raise KeyboardInterrupt
        genuine(address, data)

    with monkeypatch.context() as patch:
        patch.setattr(emulator.flash, "program", program)
        outcome = phasewire("new.dfu")
    assert outcome.code == 130
    assert "Stopped. The device boots its old firmware, or the new one if that was whole" in outcome.err
    assert not in_dfu_mode(emulator)
    emulator.run_until_started()
    assert emulator.running.info().firmware == FACTORY
    assert phasewire("new.dfu").code == 0
    assert running(emulator)[0] == NEW.version


@pytest.mark.skipif(shutil.which("openssl") is None, reason="not installed: openssl")
def test_the_commands_of_the_guide_run(phasewire: Run, emulator: Emulator) -> None:
    guide = re.findall(r"```sh\n(.*?)```", GUIDE, re.DOTALL)[0]  # the others are dfu-util's, for the kernel
    for name in ("processors.bin", "controller.bin"):
        Path(name).write_bytes(name.encode())
    for line in guide.splitlines():
        command, *arguments = shlex.split(line, comments=True)
        if command == "openssl":
            subprocess.run([command, *arguments], check=True, timeout=30, capture_output=True)
            continue
        with pytest.raises(SystemExit) as exited:
            main([emulator.url if argument == "usb:" else argument for argument in arguments])
        assert not exited.value.code, line
        if arguments[:2] == ["flash", "signed.dfu"]:
            assert running(emulator) == ((1, 2, 3), Bank.A)
    assert running(emulator) == (FACTORY, Bank.FACTORY)


@pytest.mark.parametrize("arguments", [("new.dfu",), ("--list",), ("--revert",)])
def test_a_fresh_emulated_device_is_not_taken_for_a_real_one(phasewire: Run, arguments: tuple[str, ...]) -> None:
    said = "note: emulator: is a fresh emulated device, which is gone when this command ends"
    outcome = phasewire(*arguments, "--device", "emulator:")
    assert outcome.code == 0
    assert said in " ".join(outcome.err.split())
    assert said not in phasewire(*arguments).err


def test_devices_are_listed(phasewire: Run, emulator: Emulator) -> None:
    outcome = phasewire("--list", "--json", "list.json")
    assert outcome.code == 0
    assert re.search(rf"emulator:{emulator.serial} .* run time +0\.1\.0 +FACTORY", outcome.out)
    assert json.loads(Path("list.json").read_text()) == {
        "format": "phasewire-flash-list-1",
        "devices": [
            {
                "url": emulator.url,
                "product": "phasewire five-board array (emulated)",
                "serial": emulator.serial,
                "mode": "run time",
                "firmware": "0.1.0",
                "bank": "FACTORY",
                "problem": None,
            }
        ],
    }
    with open_device(emulator.url):
        assert "FACTORY" in phasewire("--list").out
    emulator.usb.unplug()
    outcome = phasewire("--list", "--json", "-")
    assert json.loads(outcome.out) == {"format": "phasewire-flash-list-1", "devices": []}
    assert (outcome.code, "no device on the bus of" in outcome.err) == (3, True)
