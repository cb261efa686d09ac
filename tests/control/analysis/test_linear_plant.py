"""The linear models are those of the flown bench: every testbed, many rests and times."""

import json
from pathlib import Path
from typing import Any

import control
import numpy as np
import pytest
from scipy.io import loadmat

from flexslew_control.analysis.linear_plant import PlantPath as Way
from flexslew_control.analysis.linear_plant import continuous_plant, sampled_plant
from flexslew_control.analysis.model_file import save_model
from flexslew_control.analysis.nonlinear_plant import nonlinear_system, start_of
from flexslew_control.analysis.rest import Rest, linear_matrices, rest_of
from flexslew_control.analysis.signals import inputs_of, outputs_of
from flexslew_lab.trial.sources import example_trials, read_trial
from flexslew_lab.trial.trial import plant_of
from flexslew_plant.bench.bench import Bench, BenchSettings
from flexslew_plant.bench.schedule import ScheduleEntry
from flexslew_plant.errors import BadInput
from flexslew_plant.hardware.actuator import Actuator, ActuatorSettings
from flexslew_plant.measurement import EffortCommand
from flexslew_plant.own_code import ANY_CODE
from flexslew_plant.settings import validated
from flexslew_plant.testbeds import WITH_EQUATIONS, read_testbed
from flexslew_plant.testbeds.instruments.instrument import channels

OWN = f"{Path(__file__).parents[3] / 'docs/examples/three_joints.py'}:ThreeJoints"
TRIALS = [trial.name for trial in example_trials()]
KINDS = [*(kind for kind in WITH_EQUATIONS if kind != "spacecraft"), OWN]
PUSHED = {
    "kind": "spacecraft",
    "actuators": {
        f"push_{k}": {"kind": "force", "direction": [0.6, 0.8, 0.0], "place": at, "limit": 5.0}
        for k, at in enumerate(([1.0, 0.2, -0.4], [-0.8, 0.1, 0.3]))
    },
}
LAG = ActuatorSettings(lag=0.03)


def kinds() -> list[tuple[str, Any, float]]:
    """Return every testbed with its period: the table's, one of a user's own, shipped trials'."""
    found = [(k.rpartition(":")[2], bed({"kind": k}), 0.01) for k in KINDS]
    found.append(("csa, printed", bed({"kind": "csa", "variant": "printed"}), 0.01))
    found.append(("forces beside the origin", bed(PUSHED), 0.01))
    plants = [(name, plant_of(read_trial(name)[0])) for name in TRIALS]
    return found + [(name, plant.testbed, plant.period) for name, plant in plants]


def bed(values: dict[str, Any]) -> Any:
    return read_testbed(values, "here", ANY_CODE)


CASES = [
    pytest.param(testbed, period, k, id=f"{name}, {k}")
    for name, testbed, period in kinds()
    for k in range(2)
]


def rest_for(testbed: Any, number: int) -> Rest:
    """Return the rest at the start, or one elsewhere and later."""
    if number == 0:
        return rest_of(testbed)
    rng = np.random.default_rng(5)
    turning = testbed.model().reading is not None
    names = [] if turning else testbed.model().joint_names
    return rest_of(testbed, {name: 0.3 * rng.standard_normal() for name in names}, 1.37)


def flown(bench: Bench, rest: Rest, z: np.ndarray, effort: np.ndarray) -> np.ndarray:
    """Return displacement and rates after one tick of the bench, and then its readings before."""
    model, n = rest.model, rest.model.coordinates
    start = np.concatenate((rest.q + model.position_rates(rest.q, rest.time) @ z[:n], z[n:]))
    bench.reset()
    bench.tick, bench._x = round(rest.time / bench.settings.period), start
    bench._applied = effort  # an accelerometer feels what was applied
    bench._start_tick()
    seen = bench.question
    bench.offer(EffortCommand(seen.tick, seen.epoch, seen.controller, effort))
    bench.advance()
    after = bench.truth()
    back = np.linalg.pinv(model.position_rates(rest.q, rest.time + bench.settings.period))
    readings = (seen.joint_position, seen.joint_velocity, seen.tip_deflection, seen.root_curvature)
    return np.concatenate((back @ (after.position - rest.q), after.velocity, *readings))


def remembering(rest: Rest) -> set[int]:
    """Return the outputs of instruments, whose readings hold noise and what they read before."""
    first = 2 * rest.model.joints
    instruments = rest.model.appendages.instruments
    return {first + k for one in instruments for k in range(*channels(one).indices(10**6))}


def slopes(bench: Bench, rest: Rest) -> np.ndarray:
    """Return the differences of fourth order of a tick by state and effort, column by column."""
    n, m = rest.model.coordinates, rest.model.efforts
    columns = []
    for one in np.eye(2 * n + m):
        h = 3e-3 / max(1.0, float(one[2 * n :].sum()) * 1e-1)
        at = {
            s: flown(bench, rest, s * h * one[: 2 * n], rest.effort + s * h * one[2 * n :])
            for s in (-2.0, -1.0, 1.0, 2.0)
        }
        columns.append((8.0 * (at[1.0] - at[-1.0]) - (at[2.0] - at[-2.0])) / (12.0 * h))
    return np.array(columns).T


@pytest.mark.first(6)
@pytest.mark.parametrize(("testbed", "period", "number"), CASES)
def test_the_sampled_model_is_the_slope_of_a_tick_of_the_bench(
    testbed: Any, period: float, number: int
) -> None:
    rest = rest_for(testbed, number)
    bench = Bench(BenchSettings(testbed=testbed, period=period, active="x"))
    bench.limit = np.full(len(testbed.effort_limit), 1e12)
    bench.actuator = Actuator(bench.settings.actuator, bench.limit, period)
    model = sampled_plant(rest, Way(period, steps=bench._steps))
    n, found = rest.model.coordinates, slopes(bench, rest)
    ours = np.hstack((model.a[: 2 * n, : 2 * n], model.b[: 2 * n]))
    sizes = abs(found[: 2 * n]).max(axis=0)
    np.testing.assert_allclose(ours / sizes, found[: 2 * n] / sizes, atol=1e-6)
    steady = continuous_plant(rest)
    kept = [k for k in range(len(steady.c)) if k not in remembering(rest)]
    readings, read = np.hstack((steady.c, steady.d))[kept], found[2 * n :][kept]
    sizes = np.maximum(abs(read).max(axis=1, keepdims=True), 1e-12)
    np.testing.assert_allclose(readings / sizes, read / sizes, atol=1e-6)


@pytest.mark.parametrize(("testbed", "period", "number"), CASES)
def test_the_continuous_model_is_the_slope_of_the_motion(
    testbed: Any, period: float, number: int
) -> None:
    rest = rest_for(testbed, number)
    model, n = rest.model, rest.model.coordinates
    a, b = linear_matrices(rest)
    into = model.position_rates(rest.q, rest.time)

    def motion(z: np.ndarray, effort: np.ndarray) -> np.ndarray:
        x = np.concatenate((rest.q + into @ z[:n], z[n:]))
        slope = model.derivative(x, effort, rest.time)
        return np.concatenate((np.linalg.pinv(into) @ slope[: model.positions],
                               slope[model.positions :]))  # fmt: skip

    h, nothing = 3e-3, np.zeros(2 * n)
    for k, one in enumerate(np.eye(2 * n)):
        near = motion(h * one, rest.effort) - motion(-h * one, rest.effort)
        far = motion(2 * h * one, rest.effort) - motion(-2 * h * one, rest.effort)
        size = max(1.0, abs(a[:, k]).max())
        np.testing.assert_allclose(a[:, k] / size, (8 * near - far) / (12 * h * size), atol=1e-6)
    for k, one in enumerate(np.eye(model.efforts)):
        slope = motion(nothing, rest.effort + one) - motion(nothing, rest.effort)
        np.testing.assert_allclose(b[:, k], slope, atol=1e-9 * max(1.0, abs(slope).max()))


@pytest.mark.parametrize(
    "way", [Way(0.01), Way(0.01, LAG), Way(0.01, LAG, np.array([0.7, 1.2]), np.array([2.25, 3.0]))]
)
def test_the_response_of_the_sampled_model_is_that_of_the_bench(way: Any) -> None:
    testbed = read_testbed({"kind": "csa", "modes": 2, "damping_ratio": 0.01}, "here")
    rest, ticks = rest_of(testbed, {"hub_pitch": 0.5}), 400
    rng = np.random.default_rng(2)
    efforts = 1e-3 * np.repeat(rng.standard_normal((ticks // 20, 2)), 20, axis=0)
    faults = []
    if way.gain is not None:
        gains = zip(rest.model.joint_names, way.gain.tolist(), strict=True)
        faults = [{"kind": "actuator_gain", "joint": joint, "gain": gain} for joint, gain in gains]
        late = zip(rest.model.joint_names, way.delay.tolist(), strict=True)
        faults += [{"kind": "command_delay", "joint": j, "ticks": d} for j, d in late]
    settings = BenchSettings(
        testbed=read_testbed(
            {"kind": "csa", "modes": 2, "damping_ratio": 0.01, "initial": {"hub_pitch": 0.5}}, "h"
        ),
        actuator=way.actuator,
        active="x",
        allow_faults=True,
        schedule=validated(
            tuple[ScheduleEntry, ...], [{"at": 0.0, "fault": fault} for fault in faults], "here"
        ),
    )
    bench, seen = Bench(settings), []
    for effort in efforts:
        asked = bench.question
        seen.append(np.concatenate((asked.joint_position, asked.joint_velocity,
                                    asked.tip_deflection, asked.root_curvature,
                                    asked.applied_effort)))  # fmt: skip
        bench.offer(EffortCommand(asked.tick, asked.epoch, "x", effort))
        bench.advance()
    system = sampled_plant(rest, way, applied=True).state_space()
    answer = control.forced_response(system, inputs=efforts.T)
    moved = np.array(seen) - seen[0]
    size = abs(moved).max(axis=0)
    assert size.min() > 0.0
    np.testing.assert_allclose(answer.outputs.T / size, moved / size, atol=1e-5)


def test_a_motor_keeps_the_commands_of_its_own_delay_alone() -> None:
    rest = rest_of(read_testbed({"kind": "csa"}, "here"))
    model = sampled_plant(rest, Way(0.01, LAG, None, np.array([0.0, 2.25])))
    late = [name for name in model.states if ".before." in name]
    assert late == [f"effort.hub_pitch.before.{k}" for k in (1, 2, 3)]


def test_signals_are_named_and_can_be_chosen() -> None:
    testbed = read_testbed({"kind": "hub_with_appendages"}, "here")
    system = continuous_plant(rest_of(testbed)).state_space()
    assert system.input_labels == ["effort:hub"]
    assert system.output_labels[:2] == ["position:hub", "rate:hub"]
    tips = [name for name in system.output_labels if name.startswith("tip:")]
    assert len(tips) == len(testbed.model().appendages.names)
    assert system[tips, "effort:hub"].output_labels == tips
    assert len(system.state_labels) == 2 * testbed.model().coordinates


def test_the_non_linear_system_moves_as_the_bench() -> None:
    testbed = read_testbed({"kind": "csa", "modes": 2}, "here")
    model, time = testbed.model(), np.linspace(0.0, 1.0, 11)
    system = nonlinear_system(testbed)
    start = start_of(testbed, {"hub_pitch": 0.4})
    effort = np.array([3.0, -2.0])
    answer = control.input_output_response(
        system, time, np.outer(effort, np.ones(11)), start,
        solve_ivp_kwargs={"rtol": 1e-11, "atol": 1e-12},
    )  # fmt: skip
    x = model.advance(start, effort, 1.0, 100)
    np.testing.assert_allclose(answer.states[:, -1], x, atol=1e-8)
    assert system.input_labels == ["effort:base_yaw", "effort:hub_pitch"]


def test_a_file_holds_the_matrices_and_the_names(tmp_path: Path) -> None:
    rest = rest_of(read_testbed({"kind": "csa"}, "here"))
    model = sampled_plant(rest, Way(0.01, LAG))
    for ending in (".mat", ".npz", ".json"):
        save_model(model, tmp_path / f"plant{ending}")
    mat, npz = loadmat(tmp_path / "plant.mat"), np.load(tmp_path / "plant.npz")
    text = json.loads((tmp_path / "plant.json").read_text())
    for key in "ABCD":
        for kept in (mat[key], npz[key], np.array(text[key])):
            np.testing.assert_array_equal(kept, getattr(model, key.lower()))
    assert float(mat["Ts"].squeeze()) == float(npz["Ts"]) == text["Ts"] == 0.01
    names = [str(name[0]) for name in mat["outputs"].ravel()]
    assert names == npz["outputs"].tolist() == text["outputs"] == list(outputs_of(rest.model))
    assert text["inputs"] == list(inputs_of(rest.model))


def test_an_unknown_ending_is_refused(tmp_path: Path) -> None:
    model = continuous_plant(rest_of(read_testbed({"kind": "csa"}, "here")))
    with pytest.raises(BadInput, match=r"ends in \.mat, \.npz, \.json, \.yaml"):
        save_model(model, tmp_path / "plant.txt")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("period", [0.01, 0.1])
@pytest.mark.parametrize("friction", [{"viscous_friction": 0.2}, {"coulomb_friction": 0.01}])
def test_friction_that_is_stiff_beside_a_tick_is_in_the_sampled_model_as_in_the_bench(
    friction: dict[str, float], period: float
) -> None:
    testbed = plant_of(read_trial("own_spacecraft")[0]).testbed
    settings = ActuatorSettings(**friction)
    rest, h = rest_of(testbed), 1e-6  # of the wheel's rate, within the speed of dry friction
    n, wheel = rest.model.coordinates, rest.model.resolved_motors.rate[0] - rest.model.positions
    bench = Bench(BenchSettings(testbed=testbed, period=period, active="x", actuator=settings))
    model = sampled_plant(rest, Way(period, settings))
    along, effort = np.eye(2 * n)[n + wheel], np.ones(1)
    slow = h * abs(model.b).max()  # an effort that makes a motion as small

    def slope(z: np.ndarray, u: np.ndarray, size: float) -> np.ndarray:
        one, other = (flown(bench, rest, s * size * z, rest.effort + s * size * u)
                      for s in (1.0, -1.0))  # fmt: skip
        return np.asarray((one - other)[: 2 * n] / (2.0 * size))

    for ours, theirs in (
        (model.a[: 2 * n, n + wheel], slope(along, 0.0 * effort, h)),
        (model.b[: 2 * n, 0], slope(0.0 * along, effort, slow)),
    ):
        # tanh(s) at s = 0.01
        np.testing.assert_allclose(ours, theirs, atol=1e-4 * abs(theirs).max())
    assert abs(np.linalg.eigvals(model.a)).max() < 1.0 + 1e-9
