"""Single values of a trial by their path: `testbed.parameters.length` instead of a whole file."""

from collections.abc import Iterator
from typing import Any

from flexslew_plant.errors import BadInput


def overridden(values: dict[str, Any], changes: dict[str, Any]) -> dict[str, Any]:
    """Return the keys of a file with some of them changed; nothing passed in is touched.

    What no path leads through is that of `values`, and not copied.

    A path joins keys with dots; in a list the key is the number of the entry, from zero
    (`controllers.pd_feedforward.kp.1`). A key that has a dot of its own is found too. Sections
    that are not there are made, so whether a key exists is for the file's own validation to say.

    Args:
        values: what YAML holds: dictionaries, lists and scalars.
        changes: path to new value, applied in order.

    Raises:
        BadInput: a path is empty, leads through a single value, or to an entry that a list lacks.
    """
    result = dict(values)
    for path, value in changes.items():
        _put(result, path, _copied(value))
    return result


def value_at(values: dict[str, Any], path: str) -> Any:
    """Return what stands at a path, as overridden would find it.

    Raises:
        BadInput: nothing stands there.
    """
    found: Any = values
    for place, key in _steps(values, path):
        if not _holds(place, key):
            raise BadInput(f"{key} is not there", path)
        found = place[key]
    return found


def _copied(value: Any) -> Any:
    """Return a copy of all containers."""
    if isinstance(value, dict):
        return {key: _copied(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_copied(entry) for entry in value]
    return value


def _shallow(value: Any) -> Any:
    """Return a copy of a container with the same entries."""
    if isinstance(value, dict):
        return dict(value)
    return list(value) if isinstance(value, list | tuple) else value


def _put(values: dict[str, Any], path: str, value: Any) -> None:
    steps = list(_steps(values, path, make=True))
    place, key = steps[-1]
    place[key] = value


def _steps(values: Any, path: str, make: bool = False) -> Iterator[tuple[Any, Any]]:
    """Yield each container on the way with the key to go on by.

    `make` puts in missing ones and a copy of each: where one stands twice, as YAML's aliases do,
    the other stays.
    """
    rest = path.split(".")
    if not all(rest):
        raise BadInput(f"{path!r} is no path: join keys with single dots, as in testbed.modes")
    place, walked = values, ""
    while rest:
        key, rest = _next_key(place, rest, path, walked)
        yield place, key
        walked = f"{walked}.{key}".lstrip(".")
        if not rest:
            return
        if make and (not _holds(place, key) or place[key] is None):
            place[key] = {}
        if not _holds(place, key):
            raise BadInput(f"{walked} is not there", path)
        if make:
            place[key] = _shallow(place[key])
        place = place[key]


def _next_key(place: Any, rest: list[str], path: str, walked: str) -> tuple[Any, list[str]]:
    """Return the next key, the longest that is there, and what of the path is left."""
    if isinstance(place, dict):
        for count in range(len(rest), 0, -1):
            key = ".".join(rest[:count])
            if key in place:
                return key, rest[count:]
        return rest[0], rest[1:]
    if isinstance(place, list):
        if rest[0].isdigit() and int(rest[0]) < len(place):
            return int(rest[0]), rest[1:]
        raise BadInput(f"{walked} has the entries 0 to {len(place) - 1}, not {rest[0]}", path)
    raise BadInput(f"{walked} is the scalar {place!r}; it has no keys", path)


def _holds(place: Any, key: Any) -> bool:
    return isinstance(key, int) or key in place
