"""The device's text console: what is typed goes in, what the terminal shows comes out (SPEC.md, chapter CON).

A command asks the controller what a host would ask by a request. How lines are typed and parsed, and how answers are
put into words, stands in `phasewire.protocol.console`. Nothing here knows of frames, or of what the text travels over.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial
from typing import NamedTuple, Protocol

from ...base.errors import BlockError, CommandError
from ...protocol.codes import REQUEST_TYPE_IN, REQUEST_TYPE_OUT, ConsoleCode, Reason, State
from ...protocol.console import (
    COMMANDS,
    PROMPT,
    Command,
    LineEditor,
    answer_fields,
    format_error,
    format_fields,
    format_ok,
    help_fields,
    parse_command,
)
from ...protocol.replies import ANSWER_BYTES
from ...protocol.requests import VALUES, Setup
from ...protocol.states import StateEvent, after
from ..door import Door, Stall

__all__ = ["Console", "ConsoleController", "Departure", "Shown"]

Fields = Iterable[tuple[str, object]]

Departure = Callable[[], object]
"""What takes the device away: a restart, or the way to DFU mode."""


class ConsoleController(Protocol):
    """What the console needs of the controller."""

    @property
    def state(self) -> State:
        """What the device is doing."""

    @property
    def can_accept(self) -> bool:
        """Whether the queue has room."""

    def request(self, setup: Setup, data: bytes, door: Door) -> bytes:
        """Carry out a vendor request that came by a door and return its data; raise `Stall` if USB would stall."""

    def test_transducer(self, transducer: int, door: Door) -> None:
        """Drive one transducer alone, weakly; raise `BlockError` if an update would be refused."""


class Shown(NamedTuple):
    """What the console does about what was typed.

    Parameters
    ----------
    text : bytes
        The text for the terminal.
    then : callable or None
        What remains to be carried out once the text is sent (clause CON-004); nothing typed after it was read. The
        device may refuse by `Stall` if its state has changed since.
    answers : bool
        Whether the text answers a command (clause FWU-020), even if by a refusal.
    """

    text: bytes
    then: Departure | None = None
    answers: bool = False


class Console:
    """The console of one serial line."""

    def __init__(self, controller: ConsoleController, door: Door, detach: Callable[[], None]) -> None:
        self._controller = controller
        self._door = door
        self._detach = detach
        self._editor = LineEditor()
        self._answers = False

    def feed(self, typed: bytes) -> Shown:
        """Take the next bytes; answer the lines that they end, each before what is typed after it is sent back."""
        text, self._answers = bytearray(), False
        for byte in typed:
            lines, echo = self._editor.feed(bytes([byte]))
            text += echo
            for line in lines:
                answer, then = self._answer(line)
                text += (answer + PROMPT).encode("ascii")
                if then:
                    return Shown(bytes(text), then, self._answers)
        return Shown(bytes(text), answers=self._answers)

    def begin_line(self) -> bytes:
        """Forget what was typed of a line that has not ended; return the prompt for a new one."""
        self._editor = LineEditor(echo=self._editor.echo)
        return PROMPT.encode("ascii")

    def _answer(self, line: str) -> tuple[str, Departure | None]:
        try:
            command = parse_command(line)
            if command is None:
                return "", None
            self._answers = True
            return format_fields(self._carry_out(command)) + format_ok(), self._departure(command)
        except CommandError as error:
            return format_error(ConsoleCode(error.reason), str(error)), None

    def _departure(self, command: Command) -> Departure | None:
        match command.name:
            case "reset":
                return partial(self._controller.request, _setup(command), b"", self._door)
            case "dfu":
                return self._detach
        return None

    def _carry_out(self, command: Command) -> Fields:
        """Do all of a command that comes before its answer; raise `CommandError` if the device refuses."""
        match command:
            case Command("help"):
                return help_fields()
            case Command("frames"):
                return [("frames", "send the byte 00")]
            case Command("echo", on):
                self._editor.echo = bool(on)
            case Command("test", int(transducer)):
                self._test(transducer)
            case Command("dfu"):
                self._check_detach()
            case Command("reset"):
                pass  # refused in no state
            case _:
                return self._ask(command)
        return []

    def _check_detach(self) -> None:
        state = self._controller.state
        if after(state, StateEvent.DETACH) is state:
            raise _refused(f"DFU mode is not entered from the state {state.name}")

    def _test(self, transducer: int) -> None:
        if not self._controller.can_accept:
            raise _refused("the queue has no room")
        try:
            self._controller.test_transducer(transducer, self._door)
        except BlockError as error:
            reason = Reason(error.reason)
            raise _refused(f"{reason.name}: {error}") from error

    def _ask(self, command: Command) -> Fields:
        try:
            return answer_fields(command, self._controller.request(_setup(command), b"", self._door))
        except Stall as stall:
            raise _refused(str(stall)) from stall


def _refused(text: str) -> CommandError:
    return CommandError(text, ConsoleCode.REFUSED)


def _setup(command: Command) -> Setup:
    """The request that a command stands for."""
    request = COMMANDS[command.name].request
    if request is None:
        raise ValueError(f"the command {command.name} stands for no request")
    # The argument of `pulses` chooses from the answer; the request itself has none.
    value = command.argument if command.argument is not None and request in VALUES else 0
    direction = REQUEST_TYPE_IN if request in ANSWER_BYTES else REQUEST_TYPE_OUT
    return Setup(direction, request, value, 0, ANSWER_BYTES.get(request, 0))
