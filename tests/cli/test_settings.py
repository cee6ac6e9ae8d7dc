"""Defaults from a file: precedence, mistakes, and the example that documents them."""

from __future__ import annotations

import errno
import json
import os
import re
import tomllib
from pathlib import Path

import pytest
import typer
from phasewire.cli.commands import command_line
from phasewire.cli.settings import Default, config_path, defaults_from_file, effective_defaults, example

from .runner import Run


@pytest.fixture
def file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    path = tmp_path / "my.toml"
    monkeypatch.setenv("PHASEWIRE_CONFIG", str(path))
    monkeypatch.delenv("PHASEWIRE_DEVICE", raising=False)
    return path


@pytest.fixture
def root() -> typer.Context:
    return typer.Context(command_line(), info_name="phasewire")


def test_top_level_keys_apply_to_all_commands_and_tables_to_one(file: Path, root: typer.Context) -> None:
    file.write_text('link = "2wire"\n[budget]\nbaud = 9600\n[emulate]\nlink = "5wire"\n[reproduce]\noil = true\n')
    found = defaults_from_file(root)
    assert found["budget"] == {"link": "2wire", "baud": 9600}
    assert found["emulate"] == {"link": "5wire"}
    assert found["reproduce"]["figure6"] == {"oil": True}
    assert found["reproduce"]["range"] == found["stop"] == {}


def test_the_line_precedes_the_environment_and_that_the_file(
    file: Path, phasewire: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    def device(*arguments: str) -> str:
        code, _, message = phasewire("info", *arguments)
        assert code == 3
        return str(re.findall(r"no device at '(.*?)'", message)[0])

    code, out, _ = phasewire("info")
    assert (code, "(emulated)" in out) == (2, False)  # a file that is named must be there
    file.write_text('device = "top:"')
    assert device() == "top:"
    file.write_text('device = "top:"\n[info]\ndevice = "table:"')
    assert device() == "table:"
    monkeypatch.setenv("PHASEWIRE_DEVICE", "environment:")
    assert device() == "environment:"
    assert device("--device", "line:") == "line:"


WRONG = [
    # (the file, a part of the message)
    ('devize = "usb:"', 'devize = "usb:": no command has an option --devize; is it device?'),
    ("rubbish = 1", "rubbish = 1: no command has an option --rubbish"),
    ("show = 3", "show = 3: show is a command: its options belong in [show]"),
    ("[reproduce]\nrange = 3", "[reproduce] range = 3: range is a command: its options belong in [reproduce.range]"),
    ("[shou]", "shou: there is no command shou; is it show?"),
    ("[show]\nsec = 1", "[show] sec = 1: show has no option --sec; is it seconds?"),
    ("[show.seconds]\na = 1", "[show] seconds: "),
    ('[show]\nseconds = "3"', '[show] seconds = "3": must be a number; --seconds of show: How long to play, in s.'),
    ("[show]\nseconds = -1", "[show] seconds = -1: "),
    ("[show]\nseconds = [1]", "[show] seconds = [1]: must not be a list"),
    ("[show]\nseconds = true", "[show] seconds = true: must not be true or false"),
    ("[show]\nforever = 1", "[show] forever = 1: must be true or false"),
    ("device = 3", "device = 3: must be text, in quotes; --device of "),
    ("[solve]\ncolumns = 2.5", "[solve] columns = 2.5: "),
    ('[solve]\nset = "a"', '[solve] set = "a": must be a list'),
    ('[solve]\nset = ["a", 3]', '[solve] set = ["a", 3]: must be text, in quotes'),
    ("[emulate]\ncount = 2000-01-01", "[emulate] count = "),
    ("[show", "is no TOML file: "),
    ("\xff", "is no text in UTF-8: "),
    ("a = 1\na = 2", "is no TOML file: "),
]


@pytest.mark.parametrize(("text", "message"), WRONG, ids=[case[0] for case in WRONG])
def test_mistakes_in_the_file_are_named(file: Path, phasewire: Run, text: str, message: str) -> None:
    file.write_bytes(text.encode("latin-1"))
    code, out, err = phasewire("budget")
    assert (code, out) == (2, "")
    assert err.startswith(f"phasewire: {file}")
    assert message in err
    assert "Traceback" not in err


def test_a_file_in_the_folder_of_another_user_is_not_read(phasewire: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    """A container may leave $HOME as root's. The tests may run as root, so the refusal is made up."""
    monkeypatch.delenv("PHASEWIRE_CONFIG")
    path, stat = config_path(), Path.stat

    def refused(self: Path, *, follow_symlinks: bool = True) -> os.stat_result:
        if self == path:
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(self))
        return stat(self, follow_symlinks=follow_symlinks)

    monkeypatch.setattr(Path, "stat", refused)
    for command in ("budget", "config"):
        code, _, err = phasewire(command)
        assert (code, f"warning: {path}: Permission denied; $PHASEWIRE_CONFIG can name" in err) == (0, True)


def test_help_and_version_work_with_a_broken_file(file: Path, phasewire: Run) -> None:
    file.write_text("rubbish")
    assert phasewire("--help")[0] == phasewire("--version")[0] == 0


def test_config_names_the_source_of_each_default(file: Path, phasewire: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    file.write_text('[solve]\nset = ["gamma=0.5"]\n[show]\nseconds = 2\n')
    monkeypatch.setenv("PHASEWIRE_DEVICE", "usb:")
    code, out, err = phasewire("config", "--json", "-")
    assert code == 0
    record = json.loads(out)
    assert (record["format"], record["file"], record["exists"]) == ("phasewire-config-1", str(file), True)
    found = {(each["command"], each["option"]): (each["value"], each["source"]) for each in record["defaults"]}
    assert found["solve", "set"] == (["gamma=0.5"], "file")
    assert found["show", "seconds"] == (2, "file")
    assert found["show", "device"] == ("usb:", "environment")
    assert found["show", "forever"] == (False, "built-in")
    assert found["reproduce figure6", "output"] == ("figure6.png", "built-in")
    assert found["solve", "spacing"] == (None, "built-in")
    assert str(file) in err
    assert re.search(r"show +seconds +2 +file", err)


def test_init_writes_an_example_once(file: Path, phasewire: Run, root: typer.Context) -> None:
    code, out, _ = phasewire("config", "--init")
    assert (code, str(file) in out) == (0, True)
    assert file.read_text() == example(root)
    file.write_text("# mine")
    code, _, err = phasewire("config", "--init")
    assert (code, str(file) in err, file.read_text()) == (2, True, "# mine")


def test_init_makes_the_folder(tmp_path: Path, phasewire: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a" / "b" / "config.toml"
    monkeypatch.setenv("PHASEWIRE_CONFIG", str(path))
    assert phasewire("config", "--init")[0] == 0
    assert path.exists()


def test_the_example_is_all_comments_and_has_the_built_in_values(file: Path, root: typer.Context) -> None:
    """With all lines of the example in force, each option has its built-in value.

    An option without one may get the value that most others of its name have: TOML has no null.
    """
    text = example(root)
    assert tomllib.loads(text) == {}
    in_force = re.sub(r"^#(?=\[|[\w-]+ = )", "", text, flags=re.MULTILINE)
    file.write_text(in_force)
    at_the_top = {key for key, value in tomllib.loads(in_force).items() if not isinstance(value, dict)}
    assert "device" in at_the_top
    assert "seconds" not in at_the_top  # one second, for ever, or no default, each for good reasons
    before = effective_defaults(root)
    root.default_map = defaults_from_file(root)
    after = effective_defaults(root)
    assert {default.source for default in before} == {"built-in"}
    for was, became in zip(before, after, strict=True):
        assert was[:2] == became[:2]
        if was.value is None:
            assert became.value is None or was.option in at_the_top
        else:
            assert str(was.value) == str(became.value)
            assert became.source == "file"


def test_every_option_of_every_command_is_in_the_example(root: typer.Context) -> None:
    text = example(root)
    for default in effective_defaults(root):
        assert isinstance(default, Default)
        assert f"\n#{default.option} =" in text
