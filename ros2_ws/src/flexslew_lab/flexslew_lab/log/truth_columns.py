"""What the columns of a log are: the coordinates of the testbed that flew, and its sensors."""

from functools import lru_cache

from flexslew_control.law import plant_description
from flexslew_lab.log.bag_reader import Overview
from flexslew_plant.errors import BadInput
from flexslew_plant.own_code import NO_CODE, Trust
from flexslew_plant.testbeds.model import Coordinate, Model

_FIELDS = ("position", "velocity")  # of the truth, q and v


def coordinate_of(
    overview: Overview, field: str, place: int, trust: Trust = NO_CODE
) -> Coordinate | None:
    """Return the name and the unit of one entry of `position` or `velocity` of the truth.

    None: the log has neither, or names a testbed that this version or this trust does not load.

    Args:
        overview: overview of the bag, with its testbed.
        field: field of the truth.
        place: index of the entry, from 0.
        trust: classes named by the log that may be loaded.
    """
    if overview.testbed is None or field not in _FIELDS:
        return None
    model = _model(overview.testbed.settings, trust)
    known = model.state_columns[_FIELDS.index(field)] if model is not None else ()
    return known[place] if place < len(known) else None


def unit_of_tip(overview: Overview, place: int, trust: Trust = NO_CODE) -> str | None:
    """Return the unit of one entry of `tip_deflection`, which holds all sensors of a spacecraft.

    None: see coordinate_of.
    """
    model = overview.testbed and _model(overview.testbed.settings, trust)
    units = model.appendages.units if model else ()
    return units[place] if place < len(units) else None


@lru_cache(maxsize=4)
def _model(settings: str, trust: Trust) -> Model | None:
    try:
        return plant_description(settings, "the log", trust).testbed.model()
    except (BadInput, KeyError, TypeError, ValueError):
        return None
