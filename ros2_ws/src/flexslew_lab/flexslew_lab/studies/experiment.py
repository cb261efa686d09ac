"""What the experiment of a study, or its own manoeuvre, finds out about a sampled bench."""

from typing import Any

from flexslew_control.planners.excitation.excitation import EXCITATION
from flexslew_lab.identification.identification import band_of
from flexslew_lab.identification.measurements import Listener
from flexslew_lab.identification.model_file import testbed_of
from flexslew_lab.identification.modes import identify_modes
from flexslew_lab.identification.physical_fit import fit_parameters
from flexslew_lab.identification.record import Record
from flexslew_lab.run.in_process import fly
from flexslew_lab.trial.trial import Trial, follow, plan_of_trial, set_up
from flexslew_plant.errors import BadInput
from flexslew_plant.settings import plain
from flexslew_plant.testbeds import Testbed, varied


def found_by_flying(
    experiment: Trial, nominal: Testbed, fit: tuple[str, ...] = (), shakes: bool = True
) -> dict[str, Any]:
    """Return the `testbed` section of the bench of a trial as its measurements identify it.

    Args:
        experiment: an experiment, or a manoeuvre with a plan that has a design model.
        nominal: the model of the bench before, from which a fit starts.
        fit: paths of numbers in its section that are fitted; none: modes and inertias are found.
        shakes: whether its plan must be of method excitation.

    Raises:
        BadInput: if it cannot be flown, or identifies nothing; the message gives the numbers.
    """
    record, band = heard_in(experiment, shakes)
    model = identify_modes(record, band)
    if fit:
        changes = fit_parameters(model, nominal, fit).changes
        section: dict[str, Any] = plain(varied(nominal, changes, f"{experiment.name}: fit"))
    else:
        section = plain(testbed_of(model))
    return section


def heard_in(experiment: Trial, shakes: bool = True) -> tuple[Record, tuple[float, float]]:
    """Return the record of the sensors in a flight, and the band [rad/s] that it shakes.

    Args:
        experiment: see found_by_flying.
        shakes: whether its plan must be of method excitation.

    Raises:
        BadInput: if it cannot be flown, or shakes nothing.
    """
    place = f"{experiment.name}: plan"
    bench, controllers = set_up(experiment, experiment.name)
    plan = plan_of_trial(experiment, predict=False)
    band = band_of(plan, experiment.name)
    if shakes and (plan is None or plan.method != EXCITATION.name):
        raise BadInput("it shakes nothing; give a plan of method excitation", place)
    if plan is None or band is None:
        raise BadInput("believes no model with modes; give a manoeuvre that is planned", place)
    if (refused := follow(controllers, experiment.active, plan)) is not None:
        raise BadInput(str(refused), place)
    heard = Listener(bench)
    fly(bench, controllers, heard)
    if bench.failure:
        raise BadInput(bench.failure, place)
    return heard.record(experiment.name), band
