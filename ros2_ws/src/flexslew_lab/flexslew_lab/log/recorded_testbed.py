"""The testbed of the flight in a log, made from the log's description of it."""

from flexslew_control.law import plant_description
from flexslew_lab.log.bag_reader import Overview
from flexslew_plant.bench.retarget import with_requests
from flexslew_plant.errors import BadInput
from flexslew_plant.events import TargetRequested
from flexslew_plant.own_code import Trust
from flexslew_plant.testbeds import Testbed
from flexslew_plant.testbeds.model import Model


def recorded_testbed(overview: Overview, epoch: int, trust: Trust) -> Testbed | None:
    """Return the testbed of a log with all its turns, those of operators in that epoch too.

    It gives the places of the joints and the directions of antennas; None: this version does not
    have the testbed.
    """
    if overview.testbed is None:
        return None
    requests = [
        e.what for e in overview.events if isinstance(e.what, TargetRequested) and e.epoch == epoch
    ]
    try:
        plant = plant_description(overview.testbed.settings, "the log", trust)
        target_requests = [(request.text, request.start * plant.period) for request in requests]
        return with_requests(plant.testbed, target_requests)
    except (BadInput, KeyError, TypeError, ValueError):
        return None


def recorded_model(overview: Overview, trust: Trust) -> Model | None:
    """Return the model of a log's testbed; None if it is unknown."""
    testbed = recorded_testbed(overview, 0, trust)
    return None if testbed is None else testbed.model()
