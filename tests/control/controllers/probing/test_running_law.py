"""The linear form of a controller is that of its running code, of whatever class it is."""

from collections import deque
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm, solve_discrete_are
from tests.plants import plant

from flexslew_control.analysis.lti import Lti
from flexslew_control.analysis.numeric_state import assign, copied, numbers
from flexslew_control.analysis.rest import rest_of
from flexslew_control.controllers import CONTROLLERS, build_controller
from flexslew_control.controllers.controller import Controller
from flexslew_control.controllers.linear_form import KalmanForm, LinearForm, LinearObserver
from flexslew_control.controllers.probing.running_law import running_law
from flexslew_control.estimators.kalman import KalmanFilter
from flexslew_control.law import MeasuredJoints
from flexslew_control.plan import Plan
from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds import read_testbed

HUB = read_testbed({"kind": "hub_with_appendages"}, "here")
CSA = read_testbed({"kind": "csa", "modes": 1}, "here")


def described(testbed: Any) -> Any:
    return plant(0.01, testbed.effort_limit, testbed)


def controller(testbed: Any, law: str, values: dict[str, Any]) -> Controller:
    return build_controller("it", law, values, described(testbed), "here")


def answers(form: Lti, inputs: np.ndarray) -> np.ndarray:
    s, out = np.zeros(len(form.a)), []
    for w in inputs:
        out.append(form.c @ s + form.d @ w)
        s = form.a @ s + form.b @ w
    return np.array(out)


def formula(found: LinearForm, stationary: Any, inputs: np.ndarray, m: int, period: float) -> Any:
    """Return the answers of the equations of linear_form to measurements without a reference."""
    law, observer = found.law, found.observer
    z: Any
    outputs = law.from_output.shape[1]
    z, s, out, y_before, before = None, np.zeros(m), [], np.zeros(outputs), None
    for w in inputs:
        y, applied = w[:outputs], w[-2 * m : -m]
        if isinstance(observer, KalmanForm):
            f, g, c = observer.matrices.f, observer.matrices.g, observer.matrices.c
            prior = np.zeros(len(f)) if z is None else f @ z + g @ applied
            z = prior + stationary @ (y - c @ prior)
            seen = np.concatenate((z, y - c @ prior))
        else:
            assert isinstance(observer, LinearObserver)
            z = (
                observer.start @ np.zeros(outputs)
                if before is None
                else observer.state @ z + observer.effort @ applied + observer.before @ y_before
            )
            seen, y_before, before = z, y, True
        q, v = w[:m], w[m : 2 * m]
        out.append(-law.kp * q - law.kd * v + law.from_state @ seen + law.from_output @ y + s)
        if law.integration.integral:
            s = s + period * (-law.ki * q + law.to_integral @ seen)
    return np.array(out)


def settled_gain(it: Controller, rest: Any) -> Any:
    """Return the gain of a filter that has rested for ever: of the algebraic Riccati equation.

    The filter predicts its covariance exactly where a mode turns by more than 1 / 16 rad in a tick,
    as that of the hub, else by a Taylor step of second order.
    """
    estimator: Any = it.estimator
    q, c, r = estimator._q, estimator.matrices.c, np.diag(estimator.matrices.r)
    dx, du = estimator.model.jacobian(rest.state, np.zeros(rest.model.joints))
    j = np.zeros_like(q)
    j[: len(dx)] = np.hstack((dx, du))[:, : len(q)] * it.period
    slow = abs(np.linalg.eigvals(dx)).max() * it.period < 1.0 / 16.0
    f = np.eye(len(q)) + j + 0.5 * j @ j if slow else expm(j)
    p = solve_discrete_are(f.T, c.T, q, r)
    return np.linalg.solve(c @ p @ c.T + r, c @ p).T


@pytest.mark.parametrize("testbed", [HUB, CSA], ids=["hub", "csa"])
@pytest.mark.parametrize(
    ("law", "values"),
    [
        ("pd_feedforward", {"kp": [20.0], "kd": [30.0]}),
        ("collocated_pid", {"kp": [460.0], "kd": [920.0], "ki": [15.0]}),
        ("output_feedback", {"mode": "tracking_b", "observer": "steady", "model": {"modes": 1}}),
        ("lqr", {"filter": {"modal_noise": 10.0, "effort_noise": 1.0}}),
        ("proportional_integral", {"filter": {"modal_noise": 10.0, "effort_noise": 1.0}}),
    ],
)
def test_the_form_of_the_code_is_the_formula_s(testbed: Any, law: str, values: Any) -> None:
    described_ = described(testbed)
    if law in ("lqr", "proportional_integral") and testbed is CSA:
        values = {**values, "operating_point": {"hub_pitch": 0.0}}
    it, rest = controller(testbed, law, values), rest_of(testbed)
    found = running_law(it, rest, described_.effort_limit)
    still = np.zeros((2, rest.model.joints))
    plan = Plan("none", it.joint_names, 0.0, 0.01, still, still, still[:1], still[:, :0], 0.0)
    linear = CONTROLLERS[law].linear
    assert linear is not None
    form = linear(it.estimator, it.law, [plan.reference(0)])
    assert form is not None
    gain = settled_gain(it, rest) if isinstance(it.estimator, KalmanFilter) else None
    rng, m = np.random.default_rng(4), rest.model.joints
    inputs = rng.standard_normal((80, len(found.form.inputs)))
    inputs[0], inputs[:, -m:] = 0.0, 0.0
    if law == "output_feedback":
        inputs[:, 2 * m : -2 * m] = 0.0
    expected = formula(form, gain, inputs, m, 0.01)
    size = abs(expected).max()
    np.testing.assert_allclose(answers(found.form, inputs) / size, expected / size, atol=2e-6)
    assert found.mismatch < 1e-5


class Odd:
    """A law whose memory is a float, a list, a dictionary, a tuple and a queue."""

    def __init__(self) -> None:
        self.terms: dict[str, Any] = {}
        self.total, self.rows, self.named = 0.0, [0.0, 0.0], {"last": 0.0}
        self.pair, self.queue = (0.0, np.zeros(1)), deque([0.0, 0.0, 0.0])
        self.counted = 0

    def reset(self, *asked: Any) -> None:
        """Keep all."""

    def update(self, measurement: Any, estimate: Any, reference: Any) -> Any:
        e = float(reference.position[0] - measurement.joint_position[0])
        self.counted += 1
        effort = 3.0 * self.pair[0] + self.pair[1][0] + 2.0 * self.queue[0] + self.total
        effort += 0.5 * self.rows[1] + 0.25 * self.named["last"] + 7.0 * e
        self.total += 0.1 * e
        self.rows = [e, self.rows[0]]
        self.named["last"] = 0.9 * self.named["last"] + e
        self.pair = (e, np.array([0.3 * self.pair[0]]))
        self.queue.append(e)
        self.queue.popleft()
        return np.array([effort])


class Hidden:
    """A law whose memory nobody can read."""

    def __init__(self) -> None:
        self.terms: dict[str, Any] = {}
        total = np.zeros(1)

        def add(e: float) -> float:
            total[0] += e
            return float(total[0])

        self._add = add

    def reset(self, *asked: Any) -> None:
        """Keep all."""

    def update(self, measurement: Any, estimate: Any, reference: Any) -> Any:
        return np.array([self._add(reference.position[0] - measurement.joint_position[0])])


def test_memory_of_any_kind_is_found() -> None:
    it = Controller("it", MeasuredJoints(), Odd(), ("hub",), 0.01)
    found = running_law(it, rest_of(HUB, {"hub": 0.4}), np.array([10.0]))
    assert found.mismatch < 1e-9
    rng, law = np.random.default_rng(1), Odd()
    e = rng.standard_normal(50)
    inputs = np.zeros((50, len(found.form.inputs)))
    inputs[:, 0] = -e
    asked: Any = type("Asked", (), {})
    expected = []
    for value in e:
        asked.joint_position, asked.position = np.zeros(1), np.array([value])
        expected.append(law.update(asked, None, asked))
    np.testing.assert_allclose(answers(found.form, inputs), expected, atol=1e-8)


def test_memory_that_cannot_be_read_is_refused() -> None:
    it = Controller("it", MeasuredJoints(), Hidden(), ("hub",), 0.01)
    with pytest.raises(BadInput, match="it is not linear at this rest"):
        running_law(it, rest_of(HUB), np.array([10.0]))


class SlowlyHidden(Hidden):
    """A PD whose integral nobody can read, small beside it in any short motion."""

    def update(self, measurement: Any, estimate: Any, reference: Any) -> Any:
        e = reference.position[0] - measurement.joint_position[0]
        rate = reference.velocity[0] - measurement.joint_velocity[0]
        return np.array([46.0 * e + 92.0 * rate + 0.01 * 0.2 * self._add(e)])


class Single(Hidden):
    """The same, with an integral in single precision."""

    def __init__(self) -> None:
        self.terms: dict[str, Any] = {}
        self.total = np.zeros(1, dtype=np.float32)

    def update(self, measurement: Any, estimate: Any, reference: Any) -> Any:
        e = reference.position - measurement.joint_position
        self.total = self.total + e.astype(np.float32)
        rate = reference.velocity - measurement.joint_velocity
        return 46.0 * e + 92.0 * rate + 0.01 * 0.2 * self.total.astype(np.float64)


@pytest.mark.parametrize("law", [SlowlyHidden, Single])
def test_an_integral_that_cannot_be_read_is_refused_though_it_is_small_in_motion(law: Any) -> None:
    it = Controller("it", MeasuredJoints(), law(), ("hub",), 0.01)
    with pytest.raises(BadInput, match="it keeps memory outside of itself"):
        running_law(it, rest_of(HUB), np.array([10.0]))


@pytest.mark.slow
def test_a_memory_of_hours_that_still_moves_at_rest_is_no_hidden_one() -> None:
    """A lag of 200 s away from its own zero, as of a design that hears positions, not errors."""
    a, b, c, d = np.exp(-0.01 / 200.0), 0.01, -0.5, -46.0
    system = {
        "a": [[a]], "b": [[b, 0.0]], "c": [[c]], "d": [[d, -92.0]],
        "period": 0.01, "inputs": ["position.hub", "rate.hub"],
    }  # fmt: skip
    it, rest = controller(HUB, "linear", {"system": system}), rest_of(HUB, {"hub": 0.02})
    found = running_law(it, rest, described(HUB).effort_limit)
    assert found.mismatch < 1e-9
    w = np.zeros((40, len(found.form.inputs)))
    w[:, 0] = np.random.default_rng(1).standard_normal(40)
    x, expected = 0.0, []
    for value in w[:, 0]:
        expected.append([c * x + d * value])
        x = a * x + b * value
    np.testing.assert_allclose(answers(found.form, w), expected, atol=1e-7)


def test_the_controller_itself_stays_as_it_is() -> None:
    it = controller(CSA, "proportional_integral", {"filter": {"modal_noise": 1e-4}})
    before = {place: np.copy(value) for place, value in numbers(vars(it)).items()}
    running_law(it, rest_of(CSA), described(CSA).effort_limit)
    after = numbers(vars(it))
    assert before.keys() == after.keys()
    assert all(np.array_equal(before[place], after[place]) for place in before)


def test_numbers_are_set_where_they_were_found() -> None:
    root = {"law": Odd(), "pair": (1.0, [2.0, np.array([3.0])])}
    there = copied(root)
    places = numbers(there)
    for place, value in places.items():
        assign(there, place, value + 1.0)
    assert {p: v + 1.0 for p, v in places.items()} == numbers(there)
    assert numbers(root) == places


@pytest.mark.parametrize("period", [0.005, 0.01, 0.02])
def test_a_filter_that_forgets_within_months_has_a_form(period: float) -> None:
    # its disturbance hides a mode: after two days the covariance still turned with it, and the form
    # of one tick was not that of the next
    testbed = read_testbed({"kind": "floating_oscillator"}, "here")
    bench = plant(period, testbed.effort_limit, testbed)
    it, rest = build_controller("it", "proportional_integral", {}, bench, "h"), rest_of(testbed)
    found = running_law(it, rest, bench.effort_limit)
    assert found.mismatch < 1e-10
    estimator: Any = found.steady_controller.estimator
    c, p = estimator.matrices.c, estimator._prior
    own = p @ c.T @ np.linalg.inv(c @ p @ c.T + np.diag(estimator.matrices.r))
    # the least that forgets is 2e-9 a tick, which the solver of the Riccati equation loses
    np.testing.assert_allclose(own, settled_gain(it, rest), rtol=1e-4, atol=1e-9)
