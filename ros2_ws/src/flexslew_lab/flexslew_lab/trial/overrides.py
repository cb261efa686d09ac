"""Single values of a trial by their path: `testbed.parameters.length` instead of a whole file."""

from collections.abc import Sequence
from typing import Any

from flexslew_plant.errors import BadInput


def override_values(values: dict[str, Any], changes: dict[str, Any]) -> dict[str, Any]:
    """Return the keys of a file with some of them changed; nothing passed in is touched.

    What no path leads through is that of `values`, and not copied.

    A path joins keys with dots; in a list the key is the number of the entry, from zero
    (`controllers.pd_feedforward.kp.1`). A key that has a dot of its own is found too. Sections
    that do not exist are made; the file's own validation then checks whether a key is known.

    Args:
        values: what YAML holds: dictionaries, lists and scalars.
        changes: path to new value, applied in order.

    Raises:
        BadInput: a path is empty, leads through a single value, or to an entry that a list lacks.
    """
    result = dict(values)
    for path, value in changes.items():
        put(result, keys_to(result, path), value)
    return result


def keys_to(values: dict[str, Any], path: str, make: bool = True) -> tuple[Any, ...]:
    """Return the keys on the way to where `overridden` puts a value, for `put`.

    Args:
        values: what YAML holds.
        path: to the value.
        make: whether containers may be missing on the way, as `put` makes them.

    Raises:
        BadInput: see overridden; or if a container is missing without `make`.
    """
    rest, keys, prefix = _parts(path), list[Any](), ""
    place: Any = values
    while rest:
        key, rest = _next_key(place, rest, path, prefix)
        keys.append(key)
        prefix = f"{prefix}.{key}".lstrip(".")
        exists = _has_key(place, key)
        if rest and not (exists or make):
            raise BadInput(f"{key} is not there", path)
        place = place[key] if exists else None
        if make:
            place = {} if place is None else _copy_container(place)
    return tuple(keys)


def put(values: dict[str, Any], keys: Sequence[Any], value: Any) -> None:
    """Put a copy of a value where keys lead.

    Missing containers are made, and each on the way is a copy: where one stands twice, as YAML's
    aliases do, the other stays.

    Args:
        values: changed; what it holds is not touched.
        keys: see keys_to.
        value: for the last of them.
    """
    place: Any = values
    for key in keys[:-1]:
        inner = place[key] if _has_key(place, key) else None
        place[key] = {} if inner is None else _copy_container(inner)
        place = place[key]
    place[keys[-1]] = _copied(value)


def value_at(values: dict[str, Any], path: str) -> Any:
    """Return what stands at a path, as overridden would find it.

    Raises:
        BadInput: nothing stands there.
    """
    found: Any = values
    for key in keys_to(values, path, make=False):
        if not _has_key(found, key):
            raise BadInput(f"{key} is not there", path)
        found = found[key]
    return found


def _copied(value: Any) -> Any:
    """Return a copy of all containers."""
    if isinstance(value, dict):
        return {key: _copied(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_copied(entry) for entry in value]
    return value


def _copy_container(value: Any) -> Any:
    """Return a copy of a container with the same entries."""
    if isinstance(value, dict):
        return dict(value)
    return list(value) if isinstance(value, list | tuple) else value


def _parts(path: str) -> list[str]:
    """Return the keys that dots join.

    Raises:
        BadInput: one of them is empty.
    """
    parts = path.split(".")
    if not all(parts):
        raise BadInput(f"{path!r} is no path: join keys with single dots, as in testbed.modes")
    return parts


def _next_key(place: Any, rest: list[str], path: str, prefix: str) -> tuple[Any, list[str]]:
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
        raise BadInput(f"{prefix} has the entries 0 to {len(place) - 1}, not {rest[0]}", path)
    raise BadInput(f"{prefix} is the scalar {place!r}; it has no keys", path)


def _has_key(place: Any, key: Any) -> bool:
    return isinstance(key, int) or key in place
