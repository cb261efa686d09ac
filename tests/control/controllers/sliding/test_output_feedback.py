from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm
from tests.plants import plant as on_bench

from flexslew_control.controllers.sliding import output_feedback
from flexslew_control.controllers.sliding.output_feedback import OutputFeedback, build
from flexslew_control.controllers.sliding.sliding_law import SampledObserver
from flexslew_control.controllers.sliding.sliding_surface import (
    LinearSystem,
    closed_loop_matrix,
    design,
    reaching_matrix,
)
from flexslew_control.law import PlantDescription
from flexslew_lab.reproduce.laws import ofc_rows, slew
from flexslew_plant.errors import BadInput
from flexslew_plant.measurement import Measurement
from flexslew_plant.testbeds.csa import CsaTestbed
from flexslew_plant.testbeds.hub_with_appendages import HubTestbed
from flexslew_plant.testbeds.oscillators.floating_oscillator import FloatingOscillatorTestbed

PERIOD = 0.01


def two_masses(**changes: Any) -> LinearSystem:
    a = np.array([[0, 0, 1, 0], [0, 0, 0, 1], [-2, 2, 0, 0], [4, -4, 0, 0]], dtype=float)
    b = np.array([[0.0, 0.0, 1.0, 0.0]]).T
    parts = {
        "a": a,
        "b": b,
        "c": np.eye(4)[[0, 2]],
        "noise_input": b,
        "noise_density": np.array([[0.01]]),
        "sensor_density": 1e-4 * np.eye(2),
        "names": ("x1", "x2", "x1 rate", "x2 rate"),
    }
    return LinearSystem(**{**parts, **changes})


def on_testbed(pitch: float = 0.25) -> tuple[Any, Any]:
    settings, model = OutputFeedback(), CsaTestbed(modes=1).model()
    rest = model.rest({"hub_pitch": pitch})
    system = output_feedback.testbed_system(model, rest, settings, PERIOD)
    return system, design(system, output_feedback.testbed_weight(model, rest, settings), 2.0)


def nearest(found: Any, expected: Any) -> Any:
    return max(min(abs(found - value)) for value in expected)


def test_two_masses_give_the_golden_gains() -> None:
    found = design(two_masses(), np.eye(4), 2.0)
    np.testing.assert_allclose(found.surface, [[2.820359, -1.406146, 1.0, 0.869303]], atol=6e-7)
    kalman = [[0.992380, 0.876787], [0.814761, 0.794248], [0.876787, 9.944903]]
    kalman += [[0.710691, -0.042201]]
    np.testing.assert_allclose(found.observer_gain, kalman, atol=6e-7)
    poles = np.linalg.eigvals(reaching_matrix(two_masses(), found))
    assert nearest(poles, [-2.0, -1.0, -0.91018 + 2.19737j, -0.91018 - 2.19737j]) < 6e-6


@pytest.mark.parametrize("which", ["two_masses", "testbed"])
def test_reaching_and_sliding_poles_are_those_of_lemma_3_1(which: str) -> None:
    if which == "two_masses":
        system, found = two_masses(), design(two_masses(), np.eye(4), 2.0)
    else:
        system, found = on_testbed()
    expected = np.concatenate(([-2.0] * system.b.shape[1], found.sliding_poles))
    poles = np.linalg.eigvals(reaching_matrix(system, found))
    assert nearest(poles, expected) < 1e-8
    assert nearest(expected, poles) < 1e-8


@pytest.mark.parametrize("which", ["two_masses", "testbed"])
def test_controller_and_observer_separate(which: str) -> None:
    if which == "two_masses":
        system, found = two_masses(), design(two_masses(), np.eye(4), 2.0)
    else:
        system, found = on_testbed()
    # the loop written down without (20): z' = A z + B u, z_hat' = A z_hat + B u + K_f C (z - z_hat)
    a, b, g = system.a, system.b, found.surface
    kc = found.observer_gain @ system.c
    inverse = np.linalg.inv(g @ b)
    on_z, on_hat = -inverse @ g @ kc, -inverse @ (g @ (a - kc) + 2.0 * g)
    direct = np.block([[a + b @ on_z, b @ on_hat], [kc + b @ on_z, a - kc + b @ on_hat]])
    k = len(a)
    turn = np.block([[np.eye(k), np.zeros((k, k))], [np.eye(k), -np.eye(k)]])
    whole = closed_loop_matrix(system, found)
    np.testing.assert_allclose(turn @ direct @ turn, whole, atol=1e-8 * abs(whole).max())
    np.testing.assert_array_equal(whole[k:, :k], 0.0)
    separate = np.concatenate(
        (np.linalg.eigvals(reaching_matrix(system, found)), np.linalg.eigvals(a - kc))
    )
    assert nearest(np.linalg.eigvals(whole), separate) < 1e-8


def test_surface_times_input_is_the_square_of_the_input() -> None:
    system, found = on_testbed()
    square = system.b.T @ system.b
    np.testing.assert_allclose(found.surface @ system.b, square, atol=1e-12 * abs(square).max())


@pytest.mark.slow
def test_the_public_table_is_reproduced() -> None:
    wrong = [row for row in ofc_rows() if not row["ok"]]
    assert not wrong


def test_cases_order_as_in_the_paper_by_residual_and_by_effort_after_the_end() -> None:
    tips, efforts = {}, {}
    for case in ("tracking_a", "tracking_b", "rigid_hold", "pd"):
        run, end = slew(case, 0.0)
        k = int(np.ceil(end / PERIOD))
        tips[case] = abs(run.state[k:, 2:5].sum(axis=1)).max()
        efforts[case] = PERIOD * np.square(run.effort[k:]).sum()
    assert tips["tracking_a"] < tips["tracking_b"] < tips["rigid_hold"] < tips["pd"]
    assert efforts["tracking_a"] < efforts["tracking_b"] < efforts["rigid_hold"]


def test_a_softer_structure_is_calm_twenty_seconds_later() -> None:
    run, end = slew("tracking_a", 0.5, stiffness=0.9)
    later = run.state[round((end + 20.0) / PERIOD) :, 2:5].sum(axis=1)
    assert abs(later).max() < 0.06


def test_an_uncontrollable_pair_is_refused_with_its_eigenvalue() -> None:
    with pytest.raises(BadInput, match=r"not controllable: eigenvalue .*0\.338329j"):
        build(OutputFeedback(operating_point={"hub_pitch": float(np.pi / 2)}), on_bench())


def test_an_unobservable_pair_is_refused() -> None:
    with pytest.raises(BadInput, match="not observable: eigenvalue 0"):
        design(two_masses(c=np.eye(4)[[2, 3]]), np.eye(4), 2.0)


def test_weights_without_the_driven_states_are_refused() -> None:
    with pytest.raises(BadInput, match="R22 of the weights is not positive definite"):
        design(two_masses(), np.diag([1.0, 1.0, 0.0, 1.0]), 2.0)


@pytest.mark.parametrize("modes", [1, 2])
def test_the_testbed_design_exists_for_more_modes(modes: int) -> None:
    settings = OutputFeedback(model={"modes": modes}, observer="steady")
    observer, law = build(settings, on_bench())
    assert law.found.sliding_poles.real.max() < 0.0
    assert isinstance(observer, SampledObserver)
    assert observer.found.covariance.shape == (2 * (2 + modes),) * 2


def largest_estimate(testbed: Any, period: float, settings: OutputFeedback) -> float:
    """What the observer makes of a testbed at rest whose sensors are noisy, in 300 ticks."""
    limit, rng = np.array(testbed.effort_limit), np.random.default_rng(0)
    observer, _ = build(settings, PlantDescription(testbed, period, limit))
    m, largest = limit.size, 0.0
    for tick in range(300):
        q, v = 1e-4 * rng.standard_normal((2, m))
        none, still = np.zeros(m), np.zeros(0)
        now = Measurement(tick, 0, tick * period, "", q, v, still, still, none)
        if tick == 0:
            observer.reset(now)
        largest = max(largest, abs(observer.update(now).position).max())
    return largest


@pytest.mark.parametrize(
    ("testbed", "long", "short"),
    [
        (HubTestbed(), 0.01, 9.8e-5),
        (FloatingOscillatorTestbed(), 0.01, None),
        (CsaTestbed(modes=3), 0.5, 0.47),
        (CsaTestbed(modes=6), 0.1, 0.098),
    ],
    ids=["hub", "oscillator", "csa 3", "csa 6"],
)
def test_a_steady_observer_whose_steps_diverge_is_refused_with_the_period_that_does_not(
    testbed: Any, long: float, short: float | None
) -> None:
    settings = OutputFeedback(model={"modes": testbed.modes}, observer="steady")
    words = f"the longest period that works is {short:.2g} s" if short else "no period down to"
    refused = f"observer steady is not stable .*{words}.*observer: kalman"
    with pytest.raises(BadInput, match=refused):
        largest_estimate(testbed, long, settings)
    if short:
        assert largest_estimate(testbed, short, settings) < 0.1  # the errors of the start, on csa
    exact = OutputFeedback(model={"modes": testbed.modes}, observer="steady", mode="tracking_b")
    assert largest_estimate(testbed, long, exact) < 0.1


def own_covariance(observer: Any) -> Any:
    """Return P of the errors at rest, from differences of the observer's own ticks."""
    observed, h, gain = observer.observed, observer.period, observer.found.observer_gain
    system, rest = observed.system, observed.origin
    a, c = system.a, system.c
    k, outputs = len(a), len(c)

    def ahead(z: Any, y: Any) -> Any:
        still = np.zeros(system.b.shape[1])
        return observed.propagate(rest + z, c @ rest + y, still, gain, None)

    d = 1e-6
    f = np.array(
        [ahead(d * e, np.zeros(outputs)) - ahead(-d * e, np.zeros(outputs)) for e in np.eye(k)]
    ).T
    held = np.array(
        [ahead(np.zeros(k), d * e) - ahead(np.zeros(k), -d * e) for e in np.eye(outputs)]
    ).T
    f, held = f / (2.0 * d), held / (2.0 * d)
    force = system.noise_input @ system.noise_density @ system.noise_input.T
    points, weights = np.polynomial.legendre.leggauss(12)
    paths = [expm(0.5 * h * (p + 1.0) * a) for p in points]
    p = sum(0.5 * h * w * e @ force @ e.T for w, e in zip(weights, paths, strict=True))
    p = p + held @ (system.sensor_density / h) @ held.T
    for _ in range(30):  # of the sum of f^j q f^jT
        p, f = p + f @ p @ f.T, f @ f
    return p


@pytest.mark.parametrize(
    ("testbed", "mode", "sigma", "share"),
    [
        (CsaTestbed(modes=2), "tracking_a", 1e-4, 1.03),
        (CsaTestbed(modes=2), "tracking_a", 5e-6, 2.0),
        (CsaTestbed(modes=2), "tracking_b", 1e-6, 5.0),
        (HubTestbed(), "tracking_b", 1e-4, 50.0),
    ],
)
def test_a_steady_observer_states_the_covariance_of_its_own_ticks(
    testbed: Any, mode: Any, sigma: float, share: float
) -> None:
    # P of (7) knows no ticks: with gains that are fast beside one it is far too small
    limit = np.array(testbed.effort_limit)
    settings = OutputFeedback(
        model={"modes": testbed.modes},
        observer="steady",
        mode=mode,
        angle_sigma=sigma,
        rate_sigma=sigma,
    )
    observer, _ = build(settings, PlantDescription(testbed, PERIOD, limit))
    assert isinstance(observer, SampledObserver)
    still = np.zeros(limit.size)
    there = Measurement(0, 0, 0.0, "", still, still, np.zeros(0), np.zeros(0), still)
    observer.reset(there)
    stated, own = observer.update(there).covariance, own_covariance(observer)
    sizes = np.sqrt(np.diag(own))
    np.testing.assert_allclose(
        stated / np.outer(sizes, sizes), own / np.outer(sizes, sizes), atol=1e-5
    )
    assert (np.diag(own) / np.diag(observer.found.covariance)).max() > share
    c, sensors = observer.observed.system.c, observer.observed.system.sensor_density / PERIOD
    expected = np.diag(c @ own @ c.T + sensors)
    np.testing.assert_allclose(observer.innovation_variance(), expected, rtol=1e-5)


def test_the_surface_is_the_same_in_all_units() -> None:
    coupling = 0.4 * np.eye(3, 2)  # of three axes, whose inertias are one, with two modes
    mass = np.block([[np.eye(3), coupling], [coupling.T, np.eye(2)]])
    stiffness = np.diag([0.0, 0.0, 0.0, 1.0, 4.0])
    b = np.vstack((np.zeros((5, 3)), np.linalg.solve(mass, np.eye(5)[:, :3])))
    lower = np.hstack((-np.linalg.solve(mass, stiffness), np.zeros((5, 5))))
    c = np.eye(10)[[0, 1, 2, 5, 6, 7]]
    weight = np.diag([0.1, 0.1, 0.1, 1.0, 4.0, 1.0, 1.0, 1.0, 1.0, 1.0])
    names = tuple(f"x{k}" for k in range(10))

    def surface(inertia: float) -> Any:
        """Return what of the state the efforts answer to, with these inertias [kg m^2]."""
        units = np.tile([1.0, 1.0, 1.0, inertia**0.5, inertia**0.5], 2)  # modal masses are one
        a = np.vstack((np.eye(5, 10, 5), lower)) * units[:, None] / units
        inputs = units[:, None] * b / inertia
        found = design(
            LinearSystem(a, inputs, c, inputs, inertia**2 * np.eye(3), 1e-4 * np.eye(6), names),
            inertia * weight / units / units[:, None],
            2.0,
        )
        return np.linalg.solve(found.surface @ inputs, found.surface) / inertia * units

    one = surface(1.0)
    for inertia in (1e-6, 1e-3, 1e5, 1e8, 1e10):
        np.testing.assert_allclose(surface(inertia), one, atol=1e-6 * abs(one).max())
