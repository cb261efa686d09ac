"""Kernels written from equations: steps are those of the model, whatever stands on the bench."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from tests.representatives import representatives

from flexslew_lab.trial.sources import read_trial
from flexslew_plant.arrays import Vector
from flexslew_plant.testbeds import Model, read_testbed
from flexslew_plant.testbeds.compiled.batch_kernel import BATCH_WIDTH, BatchKernel
from flexslew_plant.testbeds.compiled.nystrom import NYSTROM
from flexslew_plant.testbeds.compiled.scalar_kernel import scalar_kernel
from flexslew_plant.testbeds.compiled.tape import Tape, TraceError
from flexslew_plant.testbeds.compiled.traced_kernel import traced_kernel
from flexslew_plant.testbeds.compiled.written import BlockLayout, needed, sine_numbers_of, written

SECTIONS: dict[str, dict[str, Any]] = {
    "complete csa": {"kind": "csa", "modes": 3, "damping_ratio": 0.02},
    "printed csa": {"kind": "csa", "modes": 2, "variant": "printed"},
    "floating oscillator": {"kind": "floating_oscillator", "damping_ratio": 0.01},
    "varying oscillator": {"kind": "varying_oscillator"},
    "hub": {"kind": "hub_with_appendages"},
}
TOLERANCE = 1e-10  # of one step: order 5 against order 8 for csa, rounding alone elsewhere


def some(model: Model, rng: np.random.Generator) -> tuple[Vector, Vector]:
    """Return a state and efforts: small modes, as all equations of deflections want them."""
    x = 0.2 * rng.standard_normal(model.positions + model.coordinates)
    x[model.positions - model.modes : model.positions] *= 0.01
    if model.kernels.extra_positions:
        x[3:7] /= np.linalg.norm(x[3:7])
    return x, rng.standard_normal(model.efforts)


def require_steps_of_the_model(model: Model, kernel: BatchKernel) -> None:
    """Step random states in all members and compare some with the model's own step."""
    rng = np.random.default_rng(2)
    states, efforts = zip(*(some(model, rng) for _ in range(BATCH_WIDTH)), strict=True)
    x, u = np.array(states).T, np.array(efforts).T
    w = kernel.place(np.repeat(model.packed[:, None], BATCH_WIDTH, axis=1))
    w[: x.size], w[x.size : x.size + u.size] = x.ravel(), u.ravel()
    kernel.read(BATCH_WIDTH, w)
    joints = [
        w[at : at + model.joints * BATCH_WIDTH].reshape(-1, BATCH_WIDTH)
        for at in (kernel.rows.position, kernel.rows.rate)
    ]
    joints = [part.copy() for part in joints]
    kernel.advance(0.3, 0.01, 1, BATCH_WIDTH, w)
    for k in range(0, BATCH_WIDTH, 7):
        expected = model.advance(x[:, k].copy(), u[:, k].copy(), 0.01, t=0.3)
        found = w[: x.size].reshape(x.shape)[:, k]
        assert np.abs(found - expected).max() <= TOLERANCE * max(1.0, np.abs(expected).max())
        read = model.joint_state(x[:, k].copy())
        assert all(
            np.allclose(part[:, k], r, atol=1e-13) for part, r in zip(joints, read, strict=True)
        )


@pytest.mark.slow
@pytest.mark.parametrize("name", representatives(SECTIONS, "hub"))
def test_a_step_of_all_members_is_that_of_the_model(name: str) -> None:
    model = read_testbed(SECTIONS[name], "test").model()
    kernel = traced_kernel(model, SECTIONS[name]["kind"] == "csa")
    assert kernel is not None
    require_steps_of_the_model(model, kernel)


@pytest.mark.slow
@pytest.mark.parametrize(
    "trial", representatives(["own_spacecraft", "control_moment_gyros"], "own_spacecraft")
)
def test_a_spacecraft_steps_as_the_model_does(trial: str) -> None:
    model = read_trial(trial)[0].testbed.model()
    kernel = traced_kernel(model, False)
    assert kernel is not None
    require_steps_of_the_model(model, kernel)


def in_python(tape: Tape, passes: list[dict[int, Any]], layout: BlockLayout, w: Vector) -> Vector:
    """Return what a written function makes of w."""
    names: dict[str, Any] = {"aligned_frame": lambda: None}
    names["sine_cosine"] = lambda angle: (np.sin(angle), np.cos(angle))
    exec(written("step", tape, passes, layout), names)
    after = w.copy()
    names["step"](0.0, 0.01, after)
    return after


def test_later_passes_read_what_earlier_ones_have_written() -> None:
    tape = Tape(np.array([3.0, 0.25]))
    first, second, p = tape.input("x", 0), tape.input("x", 1), tape.parameters()
    turn = tape.operation("sine", first * p[0])
    kept, results = [turn + second, 2.0], [turn * p[1], (turn + second) / (first + p[1])]
    assert [node.index for node in sine_numbers_of(tape, results)] == [turn.index]
    constants = needed(tape, [*kept, *results]).constants
    layout = BlockLayout({"x": 0, "constants": 4}, constants, 2)
    w = np.zeros(14)
    w[:4] = 0.3, -0.7, 1.1, 0.4
    w[4:8] = np.repeat(tape.evaluated(tape.packed[:, None], constants), 2)
    whole = in_python(tape, [{0: results[0], 2: results[1]}], layout, w)
    passes = [{8: kept[0], 10: kept[1], 12: turn}, {0: results[0], 2: results[1]}]
    after = in_python(tape, passes, layout, w)
    assert np.array_equal(after[:4], whole[:4])
    assert after[8:12].tolist() == [*(np.sin(3.0 * w[:2]) + w[2:4]), 2.0, 2.0]
    assert written("step", tape, passes, layout).count("sine_cosine") == 1


@pytest.mark.parametrize("variant", ["complete", "printed"])
def test_accelerations_by_hand_are_those_of_the_terms(variant: str) -> None:
    rng = np.random.default_rng(6)
    for modes in (1, 3, 12):
        kind = {"kind": "csa", "modes": modes, "damping_ratio": 0.1, "variant": variant}
        model = read_testbed(kind, "test").model()
        assert model.kernels.acceleration is not None
        for _ in range(20):
            x, u = some(model, rng)
            found = np.empty(model.coordinates)
            model.kernels.acceleration(model.packed, 0.0, x, u, found)
            expected = model.derivative(x, u)[model.coordinates :]
            assert np.allclose(found, expected, rtol=1e-12, atol=1e-12 * abs(expected).max())


def test_the_short_scheme_is_of_order_five_where_the_force_reads_positions_alone() -> None:
    errors = []
    for steps in (10, 20, 40):
        q, v, h = np.array([0.6]), np.array([0.2]), 1.0 / steps
        for _ in range(steps):
            q, v = nystrom(lambda q, v: -np.sin(q), q, v, h)
        errors.append(abs(q[0] - pendulum(1.0, 0.6, 0.2)))
    assert np.log2(errors[0] / errors[1]) > 4.7
    assert np.log2(errors[1] / errors[2]) > 4.7


def test_the_short_scheme_is_of_order_four_where_it_reads_rates() -> None:
    def force(q: Vector, v: Vector) -> Vector:
        return -np.sin(q) - 0.4 * v * abs(q)

    errors = []
    exact = solve_ivp(
        lambda t, x: [x[1], force(x[0], x[1])], (0.0, 1.0), [0.6, 0.2], rtol=1e-13, atol=1e-13
    ).y[0, -1]
    for steps in (10, 20, 40):
        q, v, h = np.array([0.6]), np.array([0.2]), 1.0 / steps
        for _ in range(steps):
            q, v = nystrom(force, q, v, h)
        errors.append(abs(q[0] - exact))
    assert np.log2(errors[0] / errors[1]) > 3.7
    assert np.log2(errors[1] / errors[2]) > 3.7


def nystrom(force: Any, q: Vector, v: Vector, h: float) -> tuple[Vector, Vector]:
    """Return position and rate a step later by the table of the scheme."""
    found: list[Vector] = []
    for i, time in enumerate([*NYSTROM.times, 1.0]):
        rows = NYSTROM.of_place[i], NYSTROM.of_rate[i]
        place, rate = (
            sum((w * a for w, a in zip(row, found, strict=False)), np.zeros(1)) for row in rows
        )
        at = q + h * time * v + h * h * place, v + h * rate
        if i < len(NYSTROM.times):
            found.append(force(*at))
    return at


def pendulum(t: float, q: float, v: float) -> float:
    """Return where a pendulum is after t by a far finer integration of another kind."""
    found = solve_ivp(lambda _, x: [x[1], -np.sin(x[0])], (0.0, t), [q, v], rtol=1e-13, atol=1e-13)
    return float(found.y[0, -1])


@pytest.mark.slow
def test_equations_that_branch_on_time_step_member_by_member() -> None:
    model = read_trial("antenna_1")[0].testbed.model()
    assert traced_kernel(model, False) is None
    require_steps_of_the_model(model, scalar_kernel(model))


def halfway(p: Vector, t: float) -> float:
    """Return when an acceleration jumps."""
    return 0.005 if t < 0.005 else np.inf


@pytest.mark.slow
def test_steps_that_do_not_go_across_jumps_go_member_by_member() -> None:
    smooth = read_testbed(SECTIONS["varying oscillator"], "test").model()
    assert traced_kernel(smooth, False) is not None
    model = replace(smooth, kernels=replace(smooth.kernels, next_jump=halfway))
    assert traced_kernel(model, False) is None
    require_steps_of_the_model(model, scalar_kernel(model))


def test_a_tape_folds_what_is_known_and_notes_nothing_twice() -> None:
    tape = Tape(np.array([2.5, 0.0, 1.0]))
    p, x = tape.parameters(), tape.input("x", 0)
    assert p[1] * x == 0.0
    assert (p[2] * x) is x
    assert (x + p[0]).index == (x + p[0]).index
    assert int(p[0]) == 2
    assert tape.fixed == {0}
    with pytest.raises(TraceError):
        bool(x < p[0] * x)


def test_what_depends_on_packed_numbers_alone_is_evaluated_for_every_member() -> None:
    rng = np.random.default_rng(5)
    tape = Tape(rng.uniform(1.5, 2.5, 3))
    a, b, c = tape.parameters()
    node = (a * b - c) / (a + 2.0)
    packed = rng.uniform(1.5, 2.5, (3, BATCH_WIDTH))
    expected = (packed[0] * packed[1] - packed[2]) / (packed[0] + 2.0)
    assert np.allclose(tape.evaluated(packed, [node.index])[0], expected, rtol=1e-14)
