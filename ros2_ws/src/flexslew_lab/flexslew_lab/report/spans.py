"""Faults and disturbances of a run, from their beginning to their end."""

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

from flexslew_lab.log.bag_reader import Overview


class Span(NamedTuple):
    """A fault or a disturbance from its beginning to its end."""

    kind: str  # fault or disturbance
    words: str  # what it is, for a person
    start: float  # [s]
    end: float  # [s]


def spans_of(overview: Overview, end: float) -> Iterator[Span]:
    """Yield faults and disturbances from their events, in the order of their beginnings."""
    testbed = overview.testbed
    units = dict(zip(testbed.joint_names, testbed.joint_units, strict=True)) if testbed else {}
    known = [
        e
        for e in overview.events
        if e.kind in ("fault", "disturbance") and isinstance(e.data, dict)
    ]
    for k, event in enumerate(known):
        data = {key: value for key, value in event.data.items() if key != "on"}
        if not event.data.get("on"):
            continue
        over = (
            e.time
            for e in known[k + 1 :]
            if e.kind == event.kind and not e.data.get("on")
            and {key: value for key, value in e.data.items() if key != "on"} == data
        )  # fmt: skip
        until = next(over, max(end, event.time))
        yield Span(event.kind, _words(event.kind, data, units), event.time, until)


def _words(kind: str, data: Mapping[str, Any], units: Mapping[str, str]) -> str:
    """Return a fault or a disturbance in words, as its settings have it."""
    if kind == "fault":
        settings = dict(data.get("fault") or {})
        name = settings.pop("kind", "fault")
        said = [f"{key} {value}" for key, value in settings.items() if value is not None]
        return f"{name} ({', '.join(said)})" if said else str(name)
    shapes = [
        f"{_shape(shape)} {'N' if units.get(joint) == 'm' else 'N m'} on {joint}"
        for joint, shape in data.items()
    ]
    return f"disturbance of {' and '.join(shapes)}"


def _shape(shape: Any) -> str:
    if not isinstance(shape, dict):
        return f"{shape:g}"
    return ", ".join(
        f"{form}: " + ", ".join(f"{k} {v:g}" for k, v in values.items() if v is not None)
        for form, values in shape.items()
        if isinstance(values, dict)
    )
