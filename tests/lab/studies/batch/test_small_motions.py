"""Observers of small motions fly in a batch as on the bench, under the laws of retargeting."""

from collections.abc import Callable
from typing import Any

import pytest
from tests.lab.studies.batch.both_ways import require_equal
from tests.representatives import representatives

from flexslew_lab.studies.batch.fleet import BatchRunner
from flexslew_lab.studies.cases import case_of
from flexslew_lab.studies.flight import simulate_case
from flexslew_lab.studies.run import PreparedStudy, prepare
from flexslew_lab.studies.study import Study

AXES = {"x": [1.0, 0.0, 0.0], "y": [0.0, 1.0, 0.0], "z": [0.0, 0.0, 1.0]}
ON_BEAM = {"appendage": "beam", "at": 1.5}
NOISE = {"joint_position": {"noise": 1e-5, "bias": 1e-5}, "joint_velocity": {"noise": 1e-4}}


def beam_that_turns(limit: float) -> dict[str, Any]:
    """Return a craft with four modes and two forces along them: eight readings for ten motions."""
    drives: tuple[tuple[str, str, dict[str, Any]], ...]
    drives = (("force", "xyz", {}), ("torque", "xyz", {}), ("force", "xy", ON_BEAM))
    return {
        "kind": "spacecraft",
        "platform": {"mass": 200.0, "inertia": {"xx": 20.0, "yy": 60.0, "zz": 80.0}},
        "appendages": {
            "beam": {
                "hinge": {
                    "place": [0.0, 0.0, 0.1],
                    "axis": AXES["x"],
                    "motion": {"to": 0.7, "duration": 0.3, "profile": "smooth"},
                },
                "shape": {
                    "kind": "beam",
                    "method": "closed_form",
                    "length": 1.5,
                    "linear_density": 1.4,
                    "bending_stiffness": 250.0,
                    "modes_across": 2,
                    "modes_third": 2,
                },
            }
        },
        "actuators": {
            f"{where.get('appendage', 'craft')}_{kind}_{axis}": {
                "kind": kind,
                "direction": AXES[axis],
                "limit": limit,
                **where,
            }
            for kind, axes, where in drives
            for axis in axes
        },
    }


# law: settings, what its plan has for it, and the key of its own that varies
LAWS: dict[str, tuple[dict[str, Any], dict[str, Any], str]] = {
    "disturbance_minimisation": (
        {"design": "sampled", "weights": {"state": 100.0}},
        {"feedforward": "disturbance_minimisation"},
        "weights.state",
    ),
    "modal_space": ({"weight": 2e-4}, {}, "weight"),
    "disturbance_accommodating": (
        {"weights": {"state": 100.0}, "model": {"platform": {"mass": 200.0}}},
        {},
        "weights.state",
    ),
}


@pytest.fixture
def turning(study_of: Callable[..., Study]) -> Callable[..., PreparedStudy]:
    """Return a function that gives a study of a law while the beam turns."""

    def make(law: str, vary: str, limit: float = 100.0, sensors: Any = NOISE) -> PreparedStudy:
        settings, plan, _ = LAWS[law]
        trial = {
            "duration": 0.5,
            "period": 0.002,
            "testbed": beam_that_turns(limit),
            "plan": {"method": "retargeting", **plan},
            "controllers": {law: settings},
            "active": law,
            "sensors": sensors,
        }
        values = {vary: {"relative": {"uniform": [-0.3, 0.3]}}}
        return prepare(study_of(flown=trial, batch=True, vary=values))

    return make


@pytest.mark.slow
@pytest.mark.parametrize("sensors", representatives([{}, NOISE], NOISE), ids=["exact", "noisy"])
@pytest.mark.parametrize("law", LAWS)
def test_a_law_on_fewer_readings_than_motions_flies_as_on_the_bench(
    turning: Callable[..., PreparedStudy], law: str, sensors: dict[str, Any]
) -> None:
    """Beside others that have gains of their own."""
    ready = turning(law, f"controllers.{law}.{LAWS[law][2]}", sensors=sensors)
    require_equal(ready, [0, 1, 3])
    cases = [case_of(ready.study, ready.samples, k) for k in range(3)]
    assert len(list(BatchRunner(ready.study, ready.plans).fly(cases))) == 1


@pytest.mark.slow
def test_an_integral_on_an_observer_stops_at_the_limits_as_on_the_bench(
    turning: Callable[..., PreparedStudy],
) -> None:
    law = "disturbance_accommodating"
    ready = turning(law, f"controllers.{law}.{LAWS[law][2]}", limit=40.0)
    require_equal(ready, [0, 1, 3])
    case = case_of(ready.study, ready.samples, 0)
    assert (simulate_case(ready.study, case, ready.plans).metrics["saturated_time"] or 0.0) > 0.0


@pytest.mark.parametrize(
    "who",
    representatives(["testbed", "controllers.disturbance_accommodating.model"], "testbed"),
)
def test_an_observer_is_as_wrong_about_its_bench_in_batches(
    turning: Callable[..., PreparedStudy], who: str
) -> None:
    """Benches differ from what all observers believe, or each believes in another bench."""
    ready = turning("disturbance_accommodating", f"{who}.platform.mass")
    require_equal(ready, [0, 1, 3])


@pytest.mark.matrix
def test_an_observer_whose_joints_come_first_flies_in_batches(
    study_of: Callable[..., Study],
) -> None:
    trial = {
        "plan": {"method": "none", "goal": {"base_yaw": 0.0}},
        "controllers": {"disturbance_minimisation": {}},
        "active": "disturbance_minimisation",
        "sensors": NOISE,
        "schedule": [{"at": 0.2, "until": 0.4, "disturbance": {"base_yaw": 20.0}}],
    }
    vary = {"testbed.parameters.bending_stiffness": {"relative": {"uniform": [-0.2, 0.2]}}}
    require_equal(prepare(study_of(flown=trial, batch=True, vary=vary)), [0, 1, 3])
