"""Plain data with one wrong name, unit or shape each: what a person mistypes, everywhere."""

from collections.abc import Iterator
from typing import Any, NamedTuple

from flexslew_plant.errors import FlexslewError

NAME = "no_such_name"
UNITS = ("kg", "furlong", "mol/s")  # none that any key is in
Path = tuple[str | int, ...]


class Wrong(NamedTuple):
    """Data with one thing wrong.

    Args:
        kind: name, unit or shape.
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
    """Yield the data with a wrong name in each mapping, and a wrong unit or shape in each value.

    Args:
        values: what YAML holds, without a fault.
        every: all shapes and units; else one of each.
    """
    for path, node in _nodes(values):
        for kind, wrong in _wrong(node, every):
            yield Wrong(kind, path, _put(values, path, wrong))


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
    named = [str(part) for part in wrong.path if not isinstance(part, int)]
    if named and not any(part in words for part in (named[-1], NAME)):
        return f"does not name {named[-1]}"
    return ""
