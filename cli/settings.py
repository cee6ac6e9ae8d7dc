"""Defaults of options from a user's file, and the command that shows them: ``config``.

The file is TOML. A key at its top is an option of every command that has it, a table holds those of one command:
``device = "usb:"``, ``[show]``, ``seconds = 5``. The command line comes first, then the environment, then the file,
then the built-in value. This module takes all commands from the command line itself, and knows none by name.
"""

from __future__ import annotations

import difflib
import errno
import json
import os
import textwrap
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, NamedTuple, cast

import typer
from typer.core import TyperGroup, TyperOption

from ..base.errors import InputFileError
from ..base.storage import check_outputs, read_toml, write_file
from .console import JsonOption, console_for, error_console, print_list, write_json

__all__ = ["CONFIG_VARIABLE", "commands", "config_path", "defaults_from_file", "each_command"]

CONFIG_VARIABLE = "PHASEWIRE_CONFIG"
FORMAT = "phasewire-config-1"
_WIDTH = 100
_SOURCES = {"DEFAULT_MAP": "file", "ENVIRONMENT": "environment"}  # click's names, and the usual ones

commands = typer.Typer(rich_markup_mode=None)


class Default(NamedTuple):
    """The value of an option that the command line does not set.

    Parameters
    ----------
    command : str
        The command's name, with those of its groups.
    option : str
        The option's name, which is its key in the file.
    value : object
        Its value; None if it has none.
    source : str
        Its source: ``built-in``, ``file`` or ``environment``.
    """

    command: str
    option: str
    value: Any
    source: str


def config_path() -> Path:
    """The path of the file: `CONFIG_VARIABLE`, else the system's place for such files."""
    if named := os.environ.get(CONFIG_VARIABLE):
        return Path(named)
    from platformdirs import user_config_path

    return user_config_path("phasewire") / "config.toml"


def defaults_from_file(context: typer.Context) -> dict[str, Any]:
    """Read the file and check it against the commands.

    Parameters
    ----------
    context : typer.Context
        The context of the command line as a whole.

    Returns
    -------
    dict
        A default map for click: options, and maps of their own for commands.

    Raises
    ------
    InputFileError
        If the file is no TOML, names an unknown command or option, or gives an option an invalid value.
    OSError
        If it cannot be read, or `CONFIG_VARIABLE` names a missing file. Another user's folder is only a warning.
    """
    path = config_path()
    may_be_missing = CONFIG_VARIABLE not in os.environ or context.invoked_subcommand == config.__name__
    if may_be_missing:
        try:
            path.stat()
        except (FileNotFoundError, NotADirectoryError):
            return {}
        except PermissionError as error:  # $HOME is another user's, as in a container
            said = f"{path}: {error.strerror}; ${CONFIG_VARIABLE} can name another file, or {os.devnull} for none"
            error_console().print(f"warning: {said}", style="yellow")
            return {}
    return _Reader(path).group(context, read_toml(path), {})


def each_command(context: typer.Context) -> Iterator[typer.Context]:
    """Every command of a group, and of the groups in it, in its context."""
    assert isinstance(context.command, TyperGroup)
    for name, command in context.command.commands.items():
        inner = typer.Context(command, parent=context, info_name=name, resilient_parsing=True)
        if isinstance(command, TyperGroup):
            yield from each_command(inner)
        else:
            yield inner


def _options(context: typer.Context) -> dict[str, TyperOption]:
    """The options of a command that have a value of their own, by each of their long names."""
    return {
        name.removeprefix("--"): option
        for option in context.command.params
        if isinstance(option, TyperOption) and not option.is_eager
        for name in option.opts
        if name.startswith("--")
    }


def _named(context: typer.Context) -> Iterator[tuple[str, TyperOption]]:
    """The options of a command, each by the first of its long names."""
    options = _options(context)
    for option in dict.fromkeys(options.values()):
        yield next(key for key, one in options.items() if one is option), option


class _Reader:
    """Checks tables against commands."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def group(self, context: typer.Context, table: Mapping[str, Any], shared: Mapping[str, Any]) -> dict[str, Any]:
        """The default map of a group from its table, and from the options of outer tables."""
        assert isinstance(context.command, TyperGroup)
        known, where = context.command.commands, _table(context)
        own = {key: value for key, value in table.items() if not isinstance(value, dict)}
        there = {name for each in each_command(context) for name in _options(each)}
        for key, value in table.items():
            if key not in own and key not in known:
                raise self._error(where, key, value, f"there is no command {key}{_near(key, known)}")
            if key in own and key in known:
                right = ".".join(filter(None, (where, key)))
                raise self._error(where, key, value, f"{key} is a command: its options belong in [{right}]")
            if key in own and key not in there:
                raise self._error(where, key, value, f"no command has an option --{key}{_near(key, there)}")
        found = {}
        for name, command in known.items():
            inner = typer.Context(command, parent=context, info_name=name, resilient_parsing=True)
            read = self.group if isinstance(command, TyperGroup) else self._command
            found[name] = read(inner, table.get(name, {}), {**shared, **own})
        return found

    def _command(self, context: typer.Context, table: Mapping[str, Any], shared: Mapping[str, Any]) -> dict[str, Any]:
        """The default map of one command."""
        options = _options(context)
        for key, value in table.items():
            if key not in options:
                problem = f"{_name(context)} has no option --{key}{_near(key, options)}"
                raise self._error(_table(context), key, value, problem)
        taken = {key: value for key, value in shared.items() if key in options} | dict(table)
        for key, value in taken.items():
            try:
                _check(context, options[key], value)
            except typer.BadParameter as error:
                problem = f"{error.message}; --{key} of {_name(context)}: {options[key].help}"
                raise self._error(_table(context) if key in table else "", key, value, problem) from error
        return {options[key].name: value for key, value in taken.items()}

    def _error(self, table: str, key: str, value: object, problem: str) -> InputFileError:
        where = f" [{table}]" if table else ""
        shown = "" if isinstance(value, dict) else f" = {_toml(value)}"
        return InputFileError(f"{self._path}:{where} {key}{shown}: {problem}")


def _check(context: typer.Context, option: TyperOption, value: Any) -> None:
    """Raise `typer.BadParameter` if an option cannot have a value. TOML has types, so text is no number here."""
    if isinstance(value, bool) != option.is_bool_flag:
        raise typer.BadParameter(f"must{'' if option.is_bool_flag else ' not'} be true or false")
    if isinstance(value, list) != option.multiple:
        raise typer.BadParameter(f"must{'' if option.multiple else ' not'} be a list")
    read = option.process_value(context, value)
    for given, one in zip(value, read, strict=True) if option.multiple else [(value, read)]:
        if isinstance(given, str) == isinstance(one, (int, float)):
            raise typer.BadParameter(f"must be {'a number' if isinstance(given, str) else 'text, in quotes'}")


def _name(context: typer.Context) -> str:
    """The name of a command, with those of its groups."""
    return context.command_path.partition(" ")[2]


def _table(context: typer.Context) -> str:
    """The name of a command's table."""
    return _name(context).replace(" ", ".")


def _near(name: str, known: Iterable[str]) -> str:
    near = difflib.get_close_matches(name, known, 1)
    return f"; is it {near[0]}?" if near else ""


def _toml(value: Any) -> str:
    """A value in TOML notation."""
    match value:
        case bool():
            return str(value).lower()
        case int() | float():
            return str(value)
        case list() | tuple():
            return f"[{', '.join(map(_toml, value))}]"
    return json.dumps(str(value), ensure_ascii=False)


def effective_defaults(context: typer.Context) -> list[Default]:
    """The value of every option of every command that the command line does not set.

    Parameters
    ----------
    context : typer.Context
        The context of the command line as a whole, with its default map.
    """
    found = []
    for each in each_command(context):
        for key, option in _named(each):
            value, source = option.consume_value(each, {})
            value = None if value == () else value  # an option that may be repeated, and is not set
            found.append(Default(_name(each), key, value, _SOURCES.get(source.name, "built-in")))
    return found


def example(context: typer.Context) -> str:
    """A file with every option and its built-in value, as comments.

    Parameters
    ----------
    context : typer.Context
        The context of the command line as a whole; its default map is ignored.
    """
    own = {_table(each): {key: _entry(key, option) for key, option in _named(each)} for each in each_command(context)}
    alike: dict[str, Counter[str]] = defaultdict(Counter)
    for entries in own.values():
        for key, entry in entries.items():
            alike[key][entry] += 1
    # Values that most commands with such an option share; a key with differing defaults would mislead at the top.
    most = {key: counted.most_common(1)[0] for key, counted in alike.items()}
    # At the top a key that is also a command, such as view, would be that command's table.
    tables = {table.partition(".")[0] for table in own}
    usual = {key: entry for key, (entry, count) in most.items() if 1 < count > alike[key].total() / 2}
    shared = {key: entry for key, entry in usual.items() if key not in tables}
    parts = [
        "# Defaults of phasewire's options. Remove the # of a line to make it effective, but not that of prose.\n"
        "# The command line comes first, then environment variables, then this file.\n",
        "# Options that several commands share:\n" + "".join(shared.values()),
    ]
    for table, entries in own.items():
        rest = [entry for key, entry in entries.items() if entry != shared.get(key)]
        if rest:
            parts.append(f"#[{table}]\n" + "".join(rest))
    return "\n".join(parts)


def _entry(key: str, option: TyperOption) -> str:
    """Lines about one option: its help, and its built-in value, if any."""
    prose = textwrap.wrap(
        option.help or "", _WIDTH, initial_indent="# ", subsequent_indent="# ", break_on_hyphens=False
    )
    value = "" if option.default in (None, ()) else _toml(option.default)
    return "\n".join([*prose, f"#{key} = {value}".rstrip()]) + "\n"


@commands.command(epilog="Example: phasewire config --init")
def config(
    context: typer.Context,
    init: Annotated[
        bool, typer.Option("--init", help="Write an example, with all lines commented out, if there is no file yet.")
    ] = False,
    json_target: JsonOption = None,
) -> None:
    """Show the values of options that the command line does not set, and their sources.

    Defaults stand in a TOML file, at $PHASEWIRE_CONFIG or the system's place for such files: keys at its top for all
    commands that have such an option, and a table for each command, as in [solve] and method = "polish".
    """
    root, path = cast("typer.Context", context.find_root()), config_path()
    check_outputs([json_target])
    out = console_for(json_target)
    if init:
        if os.path.lexists(path):
            raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(path))
        path.parent.mkdir(parents=True, exist_ok=True)
        write_file(path, example(root))
        out.print(f"Written to {path}; remove the # of the lines that should take effect.")
    elif os.access(path, os.F_OK):
        out.print(f"Defaults of options from {path}:")
    else:
        out.print(f"Defaults of options; there is no {path} (phasewire config --init writes an example).")
    found = effective_defaults(root)
    if not init:
        from rich import box
        from rich.table import Table

        table = Table("command", "option", "default", "from", box=box.SIMPLE_HEAD)
        for default in found:
            shown = "" if default.value is None else _toml(default.value)
            own = default.source != "built-in"
            table.add_row(*default[:2], shown, default.source, style="bold" if own else None)
        print_list(out, table, "command", "option", "default")
    record = {
        "format": FORMAT,
        "file": str(path),
        "exists": os.access(path, os.F_OK),
        "defaults": [default._replace(value=_plain(default.value))._asdict() for default in found],
    }
    write_json(json_target, record)


def _plain(value: Any) -> Any:
    """A value as JSON can hold it."""
    return str(value) if isinstance(value, Path) else value
