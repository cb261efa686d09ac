"""Channels of runs by name, as panels of a figure."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from flexslew_lab.flight import Flight
from flexslew_lab.notebook import place, read
from flexslew_lab.publication.differences import labels_of
from flexslew_lab.report.signals import SYNONYMS
from flexslew_plant.errors import BadInput
from flexslew_plant.near_names import spelling_hint
from flexslew_plant.own_code import NO_CODE, Trust

DEFAULT = ("position", "tip", "effort")
_MOST = 12  # panels of a figure


class LabelledRun(NamedTuple):
    """A flight with its name in the legend."""

    label: str
    flight: Flight


class ChannelPanel(NamedTuple):
    """Signals that share an axis, of one unit."""

    quantity: str  # position, tip, ...
    part: str  # joint, mode or appendage; empty: of several
    unit: str
    names: tuple[str, ...]  # of the signals


def labelled_runs(
    given: Sequence[Flight | Path | str], labels: Sequence[str] = (), trust: Trust = NO_CODE
) -> list[LabelledRun]:
    """Return runs with names that state what differs between them.

    Args:
        given: flights, or folders of runs.
        labels: their names; none: the keys of their trials that differ.
        trust: classes that their logs name and that may be loaded.

    Raises:
        BadInput: if there is no such run, or there are not as many labels as runs.
    """
    if not given:
        raise BadInput("give the folder of a run, or a flight")
    flights = [one if isinstance(one, Flight) else read(place(one, "runs"), trust) for one in given]
    if labels and len(labels) != len(flights):
        words = f"{len(flights)} runs need as many labels"
        raise BadInput(words, key="--label", value=list(labels))
    names = [flight.name if isinstance(one, Flight) else Path(one).name
             for one, flight in zip(given, flights, strict=True)]  # fmt: skip
    found = labels or labels_of([flight.trial for flight in flights], names)
    return [LabelledRun(*pair) for pair in zip(found, flights, strict=True)]


def panels_of(flights: Sequence[Flight], show: Iterable[str] = ()) -> list[ChannelPanel]:
    """Return the panels of channels: of several flights one for each signal, of one by quantity.

    A signal that is zero in all flights is left out, unless it is named or all of them are.

    Args:
        flights: at least one.
        show: names of signals or quantities, also as the log and the console name them; none:
            position, tip and effort.

    Raises:
        BadInput: if no flight has a channel of a name, or there are too many panels.
    """
    known = list(dict.fromkeys(name for flight in flights for name in flight.signals))
    units = {name: unit for flight in reversed(flights) for name, unit in flight.units.items()}
    quantities = list(dict.fromkeys(name.partition(".")[0] for name in known))
    requested = tuple(show) or tuple(name for name in DEFAULT if name in quantities)
    panels: list[ChannelPanel] = []
    for given in requested:
        quantity, dot, part = given.strip().partition(".")
        quantity = quantity if quantity in quantities else SYNONYMS.get(quantity, quantity)
        name = quantity + dot + part
        names = [one for one in known if name in (one, one.partition(".")[0])]
        if not names:
            hint = spelling_hint(given, [*quantities, *known, *SYNONYMS])
            words = f"is no channel of these runs; {hint}there are {', '.join(quantities)}"
            raise BadInput(f"--show: {given} {words}")
        moving = [one for one in names if any(map(_is_moving, flights, [one] * len(flights)))]
        names = moving or names
        if len(flights) > 1 or name in known:
            groups = [[one] for one in names]
        else:
            groups = [[one for one in names if units[one] == unit]
                      for unit in dict.fromkeys(units[one] for one in names)]  # fmt: skip
        for group in groups:
            part = group[0].partition(".")[2] if len(group) == 1 else ""
            panels.append(ChannelPanel(quantity, part, units[group[0]], tuple(group)))
    if len(panels) > _MOST:
        words = f"{len(panels)} panels, at most {_MOST}; name signals, such as {panels[0].names[0]}"
        raise BadInput(f"--show: {','.join(requested)}: {words}")
    return panels


def _is_moving(flight: Flight, name: str) -> bool:
    return name in flight.signals and bool(np.nan_to_num(flight.signals[name]).any())
