"""Expressions of the C program as trees, read from their text."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from typing import TypeAlias

_TOKENS = re.compile(
    r"\s*((?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|[A-Za-z_]\w*|->|&&|\|\||[<>=!]=|[-+*/%<>!?:()\[\],.])"
)
_LEVELS = (("||",), ("&&",), ("==", "!="), ("<", "<=", ">", ">="), ("+", "-"), ("*", "/", "%"))
_TYPES = ("real", "int")


@dataclass(frozen=True)
class Constant:
    """A number."""

    text: str


@dataclass(frozen=True)
class Lvalue:
    """A variable, an entry of an array or a member of a struct.

    Args:
        name: of the variable.
        rest: what follows it: indices and members.
    """

    name: str
    rest: str

    @property
    def text(self) -> str:
        """Its C code."""
        return self.name + self.rest


@dataclass(frozen=True)
class Operation:
    """An operator with one, two or three terms, or a cast: (real), (int)."""

    operator: str
    terms: "tuple[Expression, ...]"

    @property
    def text(self) -> str:
        """Its C code, in parentheses."""
        parts = [one.text for one in self.terms]
        if self.operator == "?":
            return f"({parts[0]} ? {parts[1]} : {parts[2]})"
        if len(parts) == 1:
            return f"({self.operator}{parts[0]})"
        return f"({parts[0]} {self.operator} {parts[1]})"


@dataclass(frozen=True)
class Call:
    """A call of a function of math.h."""

    function: str
    terms: "tuple[Expression, ...]"

    @property
    def text(self) -> str:
        """Its C code."""
        return f"{self.function}({', '.join(one.text for one in self.terms)})"


Expression: TypeAlias = Constant | Lvalue | Operation | Call


@cache
def parse(text: str) -> Expression:
    """Return the tree of an expression that the evaluator has written.

    Raises:
        ValueError: it is none.
    """
    tokens, at = list[str](), 0
    while at < len(text.rstrip()):
        found = _TOKENS.match(text, at)
        if found is None:
            raise ValueError(f"no C expression: {text[at:]}")
        tokens.append(found[1])
        at = found.end()
    reader = _Reader(tokens)
    tree = reader.choice()
    if reader.next():
        raise ValueError(f"no C expression: {text}")
    return tree


class _Reader:
    """Reads tokens by recursive descent."""

    def __init__(self, tokens: list[str]) -> None:
        self._tokens, self._at = tokens, 0

    def next(self, ahead: int = 0) -> str:
        """Return a token that comes, or an empty text after the last one."""
        at = self._at + ahead
        return self._tokens[at] if at < len(self._tokens) else ""

    def take(self, expected: str = "") -> str:
        """Return the next token and go on."""
        token = self.next()
        if not token or (expected and token != expected):
            raise ValueError(f"no C expression: {token or 'its end'} instead of {expected}")
        self._at += 1
        return token

    def choice(self) -> Expression:
        """Return an expression with the operator ? : or without."""
        test = self.binary(0)
        if self.next() != "?":
            return test
        self.take()
        yes = self.choice()
        self.take(":")
        return Operation("?", (test, yes, self.choice()))

    def binary(self, level: int) -> Expression:
        """Return an expression of the operators of a level and of those that bind more."""
        if level == len(_LEVELS):
            return self.unary()
        left = self.binary(level + 1)
        while self.next() in _LEVELS[level]:
            left = Operation(self.take(), (left, self.binary(level + 1)))
        return left

    def unary(self) -> Expression:
        """Return a number, a variable, a call, or one of them with a sign or a cast."""
        if self.next() in ("-", "!"):
            return Operation(self.take(), (self.unary(),))
        if self.next() == "(" and self.next(1) in _TYPES and self.next(2) == ")":
            self._at += 3
            return Operation(f"({self._tokens[self._at - 2]})", (self.unary(),))
        if self.next() == "(":
            self.take()
            inside = self.choice()
            self.take(")")
            return inside
        token = self.take()
        if not (token[0].isalpha() or token[0] == "_"):
            return Constant(token)
        if self.next() == "(":
            return Call(token, tuple(self._arguments()))
        first = self._at
        while self.next() in ("[", "->", "."):
            if self.take() != "[":
                self.take()
                continue
            self.choice()
            self.take("]")
        rest = " ".join(self._tokens[first : self._at])
        return Lvalue(token, re.sub(r" ?(->|\.|\[|\]) ?", r"\1", rest))

    def _arguments(self) -> Iterator[Expression]:
        self.take("(")
        while self.next() != ")":
            yield self.choice()
            if self.next() == ",":
                self.take()
        self.take(")")
