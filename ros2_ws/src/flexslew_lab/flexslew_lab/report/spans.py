"""Faults and disturbances of a run, from their beginning to their end."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

from flexslew_lab.log.bag_reader import Overview
from flexslew_plant.events import DisturbanceChanged, FaultChanged, kind_of


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
        (event.time, event.what)
        for event in overview.events
        if isinstance(event.what, FaultChanged | DisturbanceChanged)
    ]
    for k, (time, what) in enumerate(known):
        if not what.on:
            continue
        over = (at for at, other in known[k + 1 :] if other == replace(what, on=False))
        yield Span(kind_of(what), _words(what, units), time, next(over, max(end, time)))


def _words(what: FaultChanged | DisturbanceChanged, units: Mapping[str, str]) -> str:
    """Return a fault or a disturbance in words, as its settings have it."""
    if isinstance(what, FaultChanged):
        settings = {k: v for k, v in (what.fault or {}).items() if k != "kind" and v is not None}
        values = ", ".join(f"{key} {value}" for key, value in settings.items())
        return f"{what.name} ({values})" if values else what.name
    shapes = [
        f"{_shape(shape)} {'N' if units.get(joint) == 'm' else 'N m'} on {joint}"
        for joint, shape in what.shapes.items()
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
