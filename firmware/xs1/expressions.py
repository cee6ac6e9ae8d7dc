"""Expressions of assembly: numbers, symbols and what is computed from them, as in C.

A value knows how many addresses are in it, so that a distance (a difference of two labels) can be told from an address.
"""

from __future__ import annotations

import operator
import re
from collections.abc import Callable, Iterator
from typing import NamedTuple

__all__ = ["Expression", "ExpressionError", "UndefinedError", "Value", "parse_expression"]


class ExpressionError(ValueError):
    """An expression that has no value; the message says why."""


class UndefinedError(ExpressionError):
    """A symbol has no value.

    Attributes
    ----------
    name : str
    """

    def __init__(self, name: str) -> None:
        super().__init__(f"{name} is not defined")
        self.name = name


class Value(NamedTuple):
    """A number, and the number of addresses in it: 0 for a plain number, 1 for an address."""

    number: int
    addresses: int = 0


Lookup = Callable[[str], Value]
_Evaluator = Callable[[Lookup], Value]


class Expression(NamedTuple):
    """A parsed expression.

    Parameters
    ----------
    evaluate : callable
        A callable from a function that gives the values of symbols to a `Value`. It raises `ExpressionError`.
    symbols : frozenset of str
        All that occur.
    """

    evaluate: _Evaluator
    symbols: frozenset[str]


_TOKEN = re.compile(
    r"\s*(?:(?P<number>0[xX][0-9a-fA-F]+|0[bB][01]+|\d+)(?![\w.$])|(?P<symbol>\d+[bf](?!\w)|[A-Za-z_.$][\w.$]*)"
    r"|'(?P<char>\\?.)'|(?P<sign><<|>>|[-+*/%|&^~()]))"
)
_LEVELS: tuple[dict[str, Callable[[int, int], int]], ...] = (
    {"|": operator.or_},
    {"^": operator.xor},
    {"&": operator.and_},
    {"<<": operator.lshift, ">>": operator.rshift},
    {"+": operator.add, "-": operator.sub},
    {"*": operator.mul, "/": operator.floordiv, "%": operator.mod},
)
_MOST_BITS = 64
ESCAPES = {"n": 10, "t": 9, "r": 13, "b": 8, "f": 12, "v": 11, "a": 7, "0": 0, "\\": 92, '"': 34, "'": 39}
"""Characters after a backslash."""


def parse_expression(text: str, rename: Callable[[str], str] = str) -> Expression:
    """Parse an expression; operators bind as in C.

    Parameters
    ----------
    text : str
    rename : callable
        Applied to every symbol, for labels that are numbers.

    Raises
    ------
    ExpressionError
        If the text is no expression.
    """
    tokens = list(_tokens(text))
    symbols = {rename(word) for kind, word in tokens if kind == "symbol"}
    place = 0

    def take(*signs: str) -> str:
        nonlocal place
        if place < len(tokens) and tokens[place][0] == "sign" and tokens[place][1] in signs:
            place += 1
            return tokens[place - 1][1]
        return ""

    def level(number: int) -> _Evaluator:
        if number == len(_LEVELS):
            return atom()
        left = level(number + 1)
        while sign := take(*_LEVELS[number]):
            left = _binary(sign, _LEVELS[number][sign], left, level(number + 1))
        return left

    def atom() -> _Evaluator:
        nonlocal place
        if sign := take("-", "~", "+"):
            return _unary(sign, atom())
        if take("("):
            inner = level(0)
            if not take(")"):
                raise ExpressionError(f"{text.strip()!r} lacks a )")
            return inner
        if place == len(tokens) or tokens[place][0] == "sign":
            found = tokens[place][1] if place < len(tokens) else "the end"
            raise ExpressionError(f"{text.strip()!r} has {found} where a number or a symbol must be")
        kind, word = tokens[place]
        place += 1
        if kind == "symbol":
            return _symbol(rename(word))
        value = Value(_number(kind, word))
        return _constant(value)

    try:
        evaluator = level(0)
    except RecursionError:
        raise ExpressionError("the expression has too many brackets") from None
    if place < len(tokens):
        raise ExpressionError(f"{text.strip()!r} has {tokens[place][1]} where an operator must be")
    return Expression(evaluator, frozenset(symbols))


def _tokens(text: str) -> Iterator[tuple[str, str]]:
    place, text = 0, text.rstrip()
    while place < len(text):
        if not (match := _TOKEN.match(text, place)):
            raise ExpressionError(
                f"{text.strip()!r} is no number, symbol or expression, from {text[place:].strip()!r} on"
            )
        yield str(match.lastgroup), match[str(match.lastgroup)]
        place = match.end()


def _number(kind: str, word: str) -> int:
    if kind == "char":
        return ESCAPES.get(word[1:], ord(word[-1])) if len(word) > 1 else ord(word)
    if len(word) > 1 and word[0] == "0" and word.isdigit():
        try:
            return int(word, 8)
        except ValueError:
            raise ExpressionError(f"{word} begins with 0 but is no octal number") from None
    return int(word, 0)


def _constant(value: Value) -> _Evaluator:
    return lambda _: value


def _symbol(name: str) -> _Evaluator:
    return lambda lookup: lookup(name)


def _unary(sign: str, inner: _Evaluator) -> _Evaluator:
    def evaluate(lookup: Lookup) -> Value:
        number, addresses = inner(lookup)
        if sign == "~":
            if addresses:
                raise ExpressionError("~ takes a number, not an address")
            return Value(~number)
        return Value(-number, -addresses) if sign == "-" else Value(number, addresses)

    return evaluate


def _binary(sign: str, function: Callable[[int, int], int], left: _Evaluator, right: _Evaluator) -> _Evaluator:
    def evaluate(lookup: Lookup) -> Value:
        a, b = left(lookup), right(lookup)
        addresses = a.addresses + b.addresses if sign == "+" else a.addresses - b.addresses
        if sign not in "+-" and (a.addresses or b.addresses):
            raise ExpressionError(f"{sign} takes numbers, not addresses; a difference of two labels is a number")
        if sign == "<<" and b.number > _MOST_BITS:
            raise ExpressionError(f"a number shifted by {b.number} bits is too large; shift by up to {_MOST_BITS}")
        try:
            return Value(function(a.number, b.number), addresses)
        except (ZeroDivisionError, ValueError):
            raise ExpressionError(f"{a.number} {sign} {b.number} has no value") from None

    return evaluate
