"""What the experiment of a study, or its own manoeuvre, finds out about a sampled bench."""

from typing import Any

from flexslew_control.planners.excitation.excitation import EXCITATION
from flexslew_lab.identification.identification import band_of
from flexslew_lab.identification.modal.modes import identify_modes
from flexslew_lab.identification.model_file import testbed_of
from flexslew_lab.identification.physical_fit import fit_parameters
from flexslew_lab.identification.records.measurements import Listener
from flexslew_lab.identification.records.record import Record
from flexslew_lab.run.in_process import run_bench
from flexslew_lab.trial.trial import Trial, plan_of_trial, set_plan, set_up
from flexslew_plant.errors import BadInput
from flexslew_plant.settings import plain
from flexslew_plant.testbeds import Testbed, with_changes


def found_by_flying(
    experiment: Trial, nominal: Testbed, fit: tuple[str, ...] = (), require_test_input: bool = True
) -> dict[str, Any]:
    """Return the `testbed` section of the bench of a trial as its measurements identify it.

    Args:
        experiment: an experiment, or a manoeuvre with a plan that has a design model.
        nominal: the model of the bench before, from which a fit starts.
        fit: paths of numbers in its section that are fitted; none: modes and inertias are found.
        require_test_input: whether its plan must be of method excitation.

    Raises:
        BadInput: if it cannot be flown, or identifies nothing; the message gives the numbers.
    """
    record, band = record_flight(experiment, require_test_input)
    model = identify_modes(record, band)
    if fit:
        changes = fit_parameters(model, nominal, fit).changes
        section: dict[str, Any] = plain(with_changes(nominal, changes, f"{experiment.name}: fit"))
    else:
        section = plain(testbed_of(model))
    return section


def record_flight(
    experiment: Trial, require_test_input: bool = True
) -> tuple[Record, tuple[float, float]]:
    """Return the record of the sensors in a flight, and the band [rad/s] that it shakes.

    Args:
        experiment: see found_by_flying.
        require_test_input: whether its plan must be of method excitation.

    Raises:
        BadInput: if it cannot be flown, or shakes nothing.
    """
    place = f"{experiment.name}: plan"
    bench, controllers = set_up(experiment, experiment.name)
    plan = plan_of_trial(experiment, predict=False)
    band = band_of(plan, experiment.name)
    if require_test_input and (plan is None or plan.method != EXCITATION.name):
        raise BadInput("it shakes nothing; give a plan of method excitation", place)
    if plan is None or band is None:
        raise BadInput("believes no model with modes; give a manoeuvre that is planned", place)
    if (reason := set_plan(controllers, experiment.active, plan)) is not None:
        raise BadInput(str(reason), place)
    listener = Listener(bench)
    run_bench(bench, controllers, listener)
    if bench.failure:
        raise BadInput(bench.failure, place)
    return listener.record(experiment.name), band
