"""Plain data with one wrong name, number, unit or shape each: what a person mistypes."""

from collections.abc import Callable, Iterator
from math import nan
from typing import Any, NamedTuple

from flexslew_plant.errors import FlexslewError

NAME = "no_such_name"
SUFFIX = "x"  # of a key that is misspelt
UNITS = ("A", "furlong", "mol/s")  # none that any key is in
Path = tuple[str | int, ...]


class Wrong(NamedTuple):
    """Data with one thing wrong.

    Args:
        kind: name (a key more), misspelt (a key), number (NaN), unit or shape.
        path: of what is wrong.
        values: the data.
    """

    kind: str
    path: Path
    values: Any

    @property
    def pattern(self) -> tuple[str, ...]:
        """The kind and the path, entries of a list alike."""
        return self.kind, *("*" if isinstance(part, int) else str(part) for part in self.path)


def wrong_inputs(values: Any, every: bool = True) -> Iterator[Wrong]:
    """Yield the data with a wrong name in each mapping, and a wrong number, unit or shape.

    Args:
        values: what YAML holds, without a fault.
        every: all keys, shapes and units; else one of each.
    """
    for path, node in _nodes(values):
        for kind, wrong in _wrong(node, every):
            yield Wrong(kind, path, _put(values, path, wrong))
        if isinstance(node, dict):
            for key in list(node)[: None if every else 1]:
                misspelt = {f"{k}{SUFFIX}" if k == key else k: v for k, v in node.items()}
                yield Wrong("misspelt", (*path, key), _put(values, path, misspelt))


def _wrong(node: Any, every: bool) -> Iterator[tuple[str, Any]]:
    if isinstance(node, dict):
        yield "name", {**node, NAME: 0.123}
    elif isinstance(node, list):
        yield "shape", [node, node]
        if every:
            yield "shape", {NAME: 0.123}
    elif isinstance(node, bool) or node is None:
        yield "shape", [[node]]
    elif isinstance(node, int | float):
        for unit in UNITS[: None if every else 1]:
            yield "unit", f"{node} {unit}"
        yield "number", nan
        yield "shape", {NAME: 0.123}
        if every:
            yield "shape", [[node]]
    elif isinstance(node, str) and every:
        yield "shape", {NAME: 0.123}
        yield "shape", [node]


def _nodes(value: Any, path: Path = ()) -> Iterator[tuple[Path, Any]]:
    """Yield every value and where it stands; of the entries of a list the first."""
    yield path, value
    if isinstance(value, dict | list):
        inside = value.items() if isinstance(value, dict) else enumerate(value[:1])
        for key, part in inside:
            yield from _nodes(part, (*path, key))


def _put(values: Any, path: Path, value: Any) -> Any:
    if not path:
        return value
    changed: Any = dict(values) if isinstance(values, dict) else list(values)
    changed[path[0]] = _put(values[path[0]], path[1:], value)
    return changed


def fault_of(error: FlexslewError, wrong: Wrong, source: str) -> str:
    """Return what is wrong with the refusal of a wrong input; empty if nothing is."""
    words = str(error)
    if "\n" in words or not words.isprintable():
        return "more than one line"
    if source and not words.startswith(source):
        return f"does not begin with {source}"
    # of a key with dots, the last part
    named = [part.rpartition(".")[2] for part in wrong.path if isinstance(part, str)]
    if wrong.kind == "misspelt":
        written = f"{named[-1]}{SUFFIX}"
        if written not in words:
            return f"does not name {written}"
        return "" if named[-1] in words.replace(written, "") else f"does not suggest {named[-1]}"
    if named and not any(part in words for part in (named[-1], NAME)):
        return f"does not name {named[-1]}"
    return ""


def faults_of(
    values: Any,
    read: Callable[[Any], object],
    every: bool,
    source: str = "",
    unread: Callable[[Wrong], bool] = lambda wrong: False,
) -> dict[str, str]:
    """Return the wrong inputs that are not refused as they should be, by kind and path.

    Args:
        values: an input without a fault.
        read: raises FlexslewError if it refuses an input.
        every: see wrong_inputs.
        source: with which each refusal begins.
        unread: whether the reader may accept an input, since it does not use that part.
    """
    read(values)
    found = {}
    for wrong in wrong_inputs(values, every):
        if unread(wrong):
            continue
        try:
            read(wrong.values)
            fault = "is accepted"
        except FlexslewError as error:
            fault = fault_of(error, wrong, source)
        if fault:
            found[" ".join((wrong.kind, *map(str, wrong.path)))] = fault
    return found
