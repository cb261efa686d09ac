import copy
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from tests.plants import plant as on_bench

from flexslew_control.controllers import CONTROLLERS, build_controller
from flexslew_control.law import Reference, nominal_state
from flexslew_plant.errors import BadInput
from flexslew_plant.measurement import Measurement
from flexslew_plant.settings import validated

PERIOD, LIMIT = 0.01, np.array([150.0, 150.0])
VARIANTS = {  # settings beside the defaults that have code of their own
    "output_feedback": [
        {"mode": "tracking_b"},
        {"mode": "rigid_hold"},
        {"tip_sigma": 5e-3},
        {"observer": "steady"},
        {"mode": "tracking_b", "observer": "steady"},
    ],
    "lqr": [{"filter": {"tip_sigma": 5e-3}}, {"minimise_disturbance": False}],
}
LAWS = [(name, values) for name in CONTROLLERS for values in ({}, *VARIANTS.get(name, ()))]
every_law = pytest.mark.parametrize("law", LAWS, ids=str)


def built(law: Any) -> Any:
    """Return estimator and law of an entry of the table: a new entry cannot escape."""
    name, values = law
    kind = CONTROLLERS[name]
    return kind.build(validated(kind.settings, values, "test"), on_bench())


def questions(seed: int = 0, count: int = 40) -> Iterator[Any]:
    rng = np.random.default_rng(seed)
    for tick in range(count):
        small = 1e-3 * rng.standard_normal((6, 2))
        yield (
            Measurement(
                tick, 0, tick * PERIOD, "x", small[0], small[1], small[2], small[3], 10 * small[4]
            ),
            Reference(small[5], small[5], 100 * small[5], np.zeros(6), np.zeros(6)),
        )


def answers(controller: Any) -> Any:
    estimator, law = controller
    found = []
    for measurement, reference in questions():
        if measurement.tick == 0:
            estimator.reset(measurement)
        estimate = estimator.update(measurement)
        if measurement.tick == 0:
            law.reset(measurement, estimate, reference, np.array([3.0, -4.0]))
        found.append((law.update(measurement, estimate, reference), estimate, dict(law.terms)))
    return found


@every_law
def test_efforts_and_estimates_are_finite_and_of_the_right_shape(law: Any) -> None:
    for effort, estimate, terms in answers(built(law)):
        assert effort.shape == (2,)
        assert effort.dtype == np.float64
        assert np.isfinite(effort).all()
        assert estimate.position.shape == estimate.velocity.shape
        assert np.isfinite(estimate.position).all()
        assert np.isfinite(estimate.covariance).all()
        assert np.isfinite(estimate.nis)
        assert all(term.shape == (2,) for term in terms.values())


@every_law
def test_the_terms_add_up_to_the_effort(law: Any) -> None:
    for effort, _, terms in answers(built(law)):
        total = np.clip(sum(terms.values()), -LIMIT, LIMIT)
        np.testing.assert_allclose(np.clip(effort, -LIMIT, LIMIT), total, atol=1e-9)


@every_law
def test_two_runs_are_bit_identical(law: Any) -> None:
    for (effort, estimate, _), (again, once_more, _) in zip(
        answers(built(law)), answers(built(law)), strict=True
    ):
        np.testing.assert_array_equal(effort, again)
        np.testing.assert_array_equal(estimate.position, once_more.position)
        np.testing.assert_array_equal(estimate.covariance, once_more.covariance)


@every_law
def test_inputs_are_not_changed_and_old_answers_stay_as_they_were(law: Any) -> None:
    estimator, it = built(law)
    kept = []
    for measurement, reference in questions():
        before = copy.deepcopy((measurement, reference))
        if measurement.tick == 0:
            estimator.reset(measurement)
        estimate = estimator.update(measurement)
        if measurement.tick == 0:
            it.reset(measurement, estimate, reference, np.zeros(2))
        effort = it.update(measurement, estimate, reference)
        for now, then in zip((*measurement, *reference), (*before[0], *before[1]), strict=True):
            np.testing.assert_array_equal(now, then)
        assert not any(np.shares_memory(effort, part) for part in (*measurement[4:], *reference))
        kept.append((effort, estimate, copy.deepcopy((effort, estimate))))
    for effort, estimate, (old_effort, old_estimate) in kept:
        np.testing.assert_array_equal(effort, old_effort)
        for now, then in zip(estimate, old_estimate, strict=True):
            np.testing.assert_array_equal(now, then)


@every_law
def test_a_law_takes_over_without_a_step_or_does_not_look_at_the_effort_before(law: Any) -> None:
    first = []
    for handed in (np.array([37.0, -21.5]), np.zeros(2)):
        estimator, it = built(law)
        asked = list(questions(seed=3))
        for measurement, _ in asked:
            if measurement.tick == 0:
                estimator.reset(measurement)
            estimate = estimator.update(measurement)
        measurement, reference = asked[-1]
        it.reset(measurement, estimate, reference, handed)
        first.append(it.update(measurement, estimate, reference) - handed)
    free_state = np.abs(first).max() < 1e-9
    own = first[0] + [37.0, -21.5]
    assert free_state or np.allclose(own, first[1], rtol=0.0, atol=1e-9)


@every_law
def test_a_reference_without_nominal_states_serves_too(law: Any) -> None:
    estimator, it = built(law)
    measurement, _ = next(questions())
    estimator.reset(measurement)
    estimate = estimator.update(measurement)
    held = Reference(measurement.joint_position, np.zeros(2), np.zeros(2), np.zeros(0))
    it.reset(measurement, estimate, held, np.zeros(2))
    assert np.isfinite(it.update(measurement, estimate, held)).all()


def test_nominal_states_of_other_models_are_cut_or_padded() -> None:
    given = np.arange(1.0, 11.0)
    reference = Reference(np.zeros(2), np.zeros(2), np.zeros(2), given)
    np.testing.assert_array_equal(nominal_state(given, reference, 2, 1), [1, 2, 3, 6, 7, 8])
    wide = nominal_state(given, reference, 2, 4)
    np.testing.assert_array_equal(wide, [1, 2, 3, 4, 5, 0, 6, 7, 8, 9, 10, 0])


@pytest.mark.parametrize(
    ("law", "values", "key"),
    [
        ("lqr", {"operating_point": {"hub_pitch": "30 cm"}}, "operating_point.hub_pitch"),
        ("output_feedback", {"angle_sigma": "0.1 mm"}, "angle_sigma"),
        (
            "model_predictive",
            {"joint_range": {"hub_pitch": ["-1 cm", "30 deg"]}},
            "joint_range.hub_pitch.0",
        ),
    ],
)
def test_a_joint_that_turns_is_given_in_no_unit_of_one_that_slides(
    law: str, values: dict[str, Any], key: str
) -> None:
    with pytest.raises(BadInput, match=f"{key}: .* is not allowed: give a number in rad, mrad, de"):
        build_controller(law, law, values, on_bench(), "t.yaml")


def test_a_range_of_a_joint_may_be_given_in_degrees() -> None:
    values = {"joint_range": {"hub_pitch": ["-30 deg", "60 deg"]}, "operating_point": {}}
    law: Any = build_controller("x", "model_predictive", values, on_bench(), "t.yaml").law
    np.testing.assert_allclose(law._limits.upper, np.pi / 3.0)
