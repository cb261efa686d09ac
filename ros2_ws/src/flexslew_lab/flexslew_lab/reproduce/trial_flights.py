"""The shipped trials of Kwak (1989), flown on the bench as they are."""

from typing import Any

import numpy as np

from flexslew_lab.reproduce.rows import Row, relative
from flexslew_lab.reproduce.scole_flights import example_trial
from flexslew_lab.run.flight_log import FlightLog
from flexslew_lab.run.in_process import run_bench
from flexslew_lab.trial.trial import Trial, plan_of_trial, set_up
from flexslew_plant.arrays import Matrix
from flexslew_plant.testbeds.contract import Pointing
from flexslew_plant.testbeds.spacecraft.units import FOOT

# peaks of the trials as they are shipped, by the names of their columns: of antenna_1 by an
# independent sampled regulator at 1 ms; of the others those of the continuous linear equations
# (2 %: the bench holds efforts and does not linearise)
_TRIALS: tuple[tuple[str, dict[str, Any], float, dict[str, float]], ...] = (
    (
        "antenna_1",
        {},
        1e-3,
        {"R_y [ft]": 0.00019359, "theta_x [rad]": 0.00064673, "tip [ft]": 0.0061457},
    ),
    (
        "antenna_2",
        {},
        0.02,
        {
            "R_x [ft]": 5.4305e-5,
            "R_y [ft]": 5.4230e-5,
            "R_z [ft]": 8.2804e-5,
            "theta_y [rad]": 2.1567e-4,
        },
    ),
    (
        "antenna_4",
        {"plan": {"end_condition": "zero"}},
        0.02,
        {
            "R_y [ft]": 0.000872318,
            "R_z [ft]": 0.000855591,
            "theta_x [rad]": float(np.radians(0.237500)),
        },
    ),
)


def states(trial: Trial) -> tuple[Matrix, Matrix]:
    """Return q and v of a trial's flight at all ticks, its controller in charge alone."""
    bench, controllers = set_up(trial, trial.name)
    controller, plan = controllers[trial.active], plan_of_trial(trial, predict=False)
    seen = FlightLog(bench, plan)
    error = controller.adopt(plan) if plan is not None else None
    assert error is None, error
    run_bench(bench, {trial.active: controller}, seen)
    assert not bench.failure, bench.failure
    return (
        np.array([row.position for row in seen.truth_log]),
        np.array([row.velocity for row in seen.truth_log]),
    )


def peaks(name: str, changes: dict[str, Any] | None = None) -> dict[str, float]:
    """Return the largest motions of a shipped antenna trial, in the units of its paper.

    Args:
        name: of the trial.
        changes: keys of its file.
    """
    trial = example_trial(name, changes)
    testbed = trial.testbed
    assert isinstance(testbed, Pointing)
    m = testbed.motions(*states(trial), {})
    place, rotation = abs(m.place).max(axis=0) / FOOT, abs(m.turned).max(axis=0)
    tip = max(float(abs(motion).max()) for motion in m.tips.values()) / FOOT
    found = {f"R_{axis} [ft]": float(x) for axis, x in zip("xyz", place, strict=True)}
    found |= {f"theta_{axis} [rad]": float(x) for axis, x in zip("xyz", rotation, strict=True)}
    return {**found, "tip [ft]": tip}


def example_trial_rows(names: tuple[str, ...] = ()) -> list[Row]:
    """Return the peaks of the shipped trials, flown on the bench.

    Args:
        names: of those that are flown; empty: all.
    """
    rows = []
    for name, changes, tolerance, references in _TRIALS:
        if names and name not in names:
            continue
        computed = peaks(name, changes)
        item = f"trial {name}" + (", P1(tf) = 0" if changes else "")
        rows += [
            relative(f"{item}: {column}", "not printed", reference, computed[column], tolerance)
            for column, reference in references.items()
        ]
    return rows
