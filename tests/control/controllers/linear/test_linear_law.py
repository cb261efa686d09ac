"""Law `linear`: from every kind of file, checked, flown as what it is, in a batch."""

import os
from pathlib import Path
from typing import Any

import control
import numpy as np
import pytest
from scipy.io import savemat
from tests.plants import plant

from flexslew_control.analysis.linear_plant import PlantPath, sampled_plant
from flexslew_control.analysis.rest import rest_of
from flexslew_control.analysis.save_law import save_law
from flexslew_control.controllers import CONTROLLERS, build_controller, with_file
from flexslew_control.controllers.host import merged
from flexslew_control.controllers.linear.linear_law import LinearSettings, to_discrete
from flexslew_control.controllers.linear_form import LinearObserver
from flexslew_control.law import MeasuredJoints, Reference
from flexslew_lab.analysis.analysis import loop_analysis
from flexslew_lab.notebook import fly, trial
from flexslew_lab.replay.resim import resim
from flexslew_plant.errors import BadInput
from flexslew_plant.measurement import Measurement
from flexslew_plant.settings import validated
from flexslew_plant.state_space import StateSpace
from flexslew_plant.testbeds import read_testbed

D = np.array([[460.0, 0.0, 920.0, 0.0], [0.0, 460.0, 0.0, 920.0]])
PD = {"d": D.tolist()}
NONE = np.zeros(2)
SEEN = MeasuredJoints()


def built(**settings: Any) -> Any:
    return build_controller("it", "linear", settings, plant(), "here")


def asked(tick: int, seed: int = 1) -> tuple[Measurement, Reference]:
    rng = np.random.default_rng([seed, tick])
    q, v, tip, curvature, applied, expected, rate = 1e-3 * rng.standard_normal((7, 2))
    return (
        Measurement(tick, 0, 0.01 * tick, "it", q, v, tip, curvature, applied),
        Reference(expected, rate, 100.0 * expected, np.zeros(0)),
    )


def test_gains_alone_fly_as_the_law_that_they_are() -> None:
    keys = {"duration": 12.0, "plan": {"method": "reference_only", "goal": {"hub_pitch": 0.5},
                                       "duration": 10.0}}  # fmt: skip
    ours = fly(trial("m1", {**keys, "controllers": {"linear": {"system": PD}},
                            "active": "linear"}))  # fmt: skip
    theirs = fly(trial("m1", keys))
    np.testing.assert_allclose(ours["position"], theirs["position"], atol=1e-12)


def test_every_kind_of_file_holds_the_same_law(tmp_path: Path) -> None:
    a, b = -0.5 * np.eye(2), np.hstack((np.eye(2), np.zeros((2, 2))))
    system = control.ss(a, b, np.eye(2), D, inputs=[
        "error:base_yaw", "error:hub_pitch", "error_rate:base_yaw", "error_rate:hub_pitch",
    ], outputs=["effort:base_yaw", "effort:hub_pitch"])  # fmt: skip
    for ending in (".mat", ".npz", ".yaml", ".json"):
        save_law(system, tmp_path / f"law{ending}")
    cells = np.array([name.replace(":", ".") for name in system.input_labels], dtype=object)
    savemat(tmp_path / "matlab.mat", {"A": a, "B": b, "C": np.eye(2), "D": D, "Ts": 0.0,
                                      "inputs": cells.reshape(-1, 1)})  # fmt: skip
    found = [with_file("linear", {"file": str(path)}, "here") for path in tmp_path.iterdir()]
    assert len(found) == 5
    for values in found:
        assert values["system"]["a"] == a.tolist()
        assert values["system"]["d"] == D.tolist()
        assert list(values["system"]["inputs"]) == cells.tolist()
        built(**values)


def test_a_transfer_function_is_saved_as_the_state_space_that_it_is(tmp_path: Path) -> None:
    lead, path = control.tf([920.0, 460.0], [0.01, 1.0]), str(tmp_path / "lead.npz")
    save_law(lead, path, "error.base_yaw", "effort.base_yaw")
    system = with_file("linear", {"file": path}, "here")["system"]
    assert (system["inputs"], system["outputs"]) == (["error.base_yaw"], ["effort.base_yaw"])
    flown = control.ss(*(system[name] for name in "abcd"))
    for frequency in (0.0, 3.0, 300.0):
        assert flown(1j * frequency) == pytest.approx(lead(1j * frequency), rel=1e-9)


@pytest.mark.parametrize(
    "system",
    [control.tf([1.0, 1.0], [1.0]), control.frd([1.0], [1.0]), np.eye(1), 7.0],
    ids=["improper", "data", "array", "number"],
)
def test_what_is_no_state_space_is_refused_with_what_to_do(system: Any, tmp_path: Path) -> None:
    with pytest.raises(BadInput, match=r"is no state space .*; join proper parts: control\.append"):
        save_law(system, tmp_path / "law.npz", ["error.base_yaw"], ["effort.base_yaw"])
    assert not list(tmp_path.iterdir())


def test_a_file_leaves_nothing_of_the_system_that_it_replaces(tmp_path: Path) -> None:
    before = {"system": {"a": [[-1.0]], "b": [[1.0] * 4], "c": [[1.0], [2.0]], "d": D.tolist(),
                         "outputs": ["effort.hub_pitch", "effort.base_yaw"]}}  # fmt: skip
    np.savez(tmp_path / "gains.npz", D=D)
    file = with_file("linear", {"file": str(tmp_path / "gains.npz")}, "here")
    assert validated(LinearSettings, merged(before, file), "") == LinearSettings(
        system=StateSpace(d=tuple(map(tuple, D.tolist())))
    )


MATLAB = b"MATLAB 7.3 MAT-file, Platform: GLNXA64, Created on: Mon Jan  1 00:00:00 2024 HDF5 schema"


def test_a_file_of_matlab_7_3_needs_h5py_or_is_saved_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    path = tmp_path / "law.mat"
    path.write_bytes(MATLAB.ljust(124) + b"\x00\x02IM" + b"\x89HDF\r\n\x1a\n" + bytes(400))
    with pytest.raises(
        BadInput,
        match=r"law\.mat: .* version 7\.3, which needs the package h5py: .* -v7: save .* -v7$",
    ):
        with_file("linear", {"file": str(path)}, "here")


@pytest.mark.parametrize("ending", [".mat", ".npz", ".json"])
def test_a_damaged_file_is_refused_in_one_line_or_harmless(ending: str, tmp_path: Path) -> None:
    """SciPy ends its process over some of these files, NumPy raises what zip and zlib raise."""
    rng, path = np.random.default_rng(7), tmp_path / f"law{ending}"
    system = control.ss(-np.eye(2), D[:, :2], np.eye(2), 0.0 * D[:, :2])
    save_law(system, path, ["error.base_yaw", "error.hub_pitch"], ["effort.base_yaw"] * 2)
    whole, words = path.read_bytes(), []
    for _ in range(4 if ending == ".mat" else 60):  # a process each
        content = bytearray(whole[: int(rng.integers(1, len(whole)))])
        content[int(rng.integers(len(content)))] ^= 1 << int(rng.integers(8))
        path.write_bytes(content)
        try:
            with_file("linear", {"file": str(path)}, "here")
        except BadInput as error:
            words.append(str(error))
    assert words
    assert not any("\n" in line for line in words)


def test_what_is_no_file_is_refused_and_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(pipe := tmp_path / "law.yaml")
    with pytest.raises(BadInput, match=r"law\.yaml: cannot be read: it is no regular file"):
        with_file("linear", {"file": str(pipe)}, "here")


def test_a_bag_is_flown_again_without_the_file(tmp_path: Path) -> None:
    path = tmp_path / "law.npz"
    np.savez(path, D=D)
    what = trial("m1", {"duration": 1.0, "plan": None, "testbed.initial.hub_pitch": 0.1,
                        "controllers": {"linear": {"file": str(path)}}, "active": "linear",
                        "schedule": [{"at": 0.2, "disturbance": {"base_yaw": 5.0}}]})  # fmt: skip
    fly(what, tmp_path / "run")
    path.unlink()
    again = resim(tmp_path / "run" / "bag")
    assert again.identical
    assert again.ticks == 101


@pytest.mark.parametrize(
    ("method", "prewarping"), [("hold", None), ("tustin", None), ("tustin", 3.0)]
)
def test_continuous_systems_are_discretised_as_by_python_control(
    method: Any, prewarping: Any
) -> None:
    rng = np.random.default_rng(2)
    a, b, c, d = (rng.standard_normal(shape) for shape in ((3, 3), (3, 2), (2, 3), (2, 2)))
    ours = to_discrete(LinearSettings(method=method, prewarping=prewarping), a, b, c, d, 0.01)
    kind = "zoh" if method == "hold" else "bilinear"
    theirs = control.sample_system(control.ss(a, b, c, d), 0.01, kind, prewarp_frequency=prewarping)
    z = np.exp(1j * 0.01 * np.array([0.3, 3.0, 100.0]))
    for one in z:
        value = ours[2] @ np.linalg.solve(one * np.eye(3) - ours[0], ours[1]) + ours[3]
        np.testing.assert_allclose(value, theirs(one), rtol=1e-9)


def test_a_law_with_a_state_takes_over_without_a_step_and_does_not_wind_up() -> None:
    integral = {"a": np.eye(2).tolist(), "b": (0.15 * np.eye(2, 4)).tolist(),
                "c": np.eye(2).tolist(), "d": D.tolist(), "period": 0.01}  # fmt: skip
    law = built(system=integral, tracking_time=1.0).law
    for tick in (7, 8):
        measurement, reference = asked(tick)
        law.reset(measurement, SEEN.update(measurement), reference, np.array([37.0, -21.5]))
        np.testing.assert_allclose(
            law.update(measurement, SEEN.update(measurement), reference), [37.0, -21.5]
        )
    far = Reference(np.array([1.0, 0.0]), NONE, NONE, np.zeros(0))
    for tick in range(9, 3000):
        measurement, _ = asked(tick)
        effort = law.update(measurement, SEEN.update(measurement), far)
    assert effort[0] == 150.0
    # held at the limit, the demand stands off it by what the integral gains in T_t
    assert law._x[0] + 460.0 < 150.0 + 1.0 * 15.0 + 460.0 * 0.02


def test_its_form_for_batches_gives_its_own_efforts() -> None:
    rng = np.random.default_rng(5)
    system = {"a": (0.9 * np.eye(3)).tolist(), "b": rng.standard_normal((3, 5)).tolist(),
              "c": (50.0 * rng.standard_normal((2, 3))).tolist(),
              "d": rng.standard_normal((2, 5)).tolist(), "period": 0.01,
              "inputs": ["error.base_yaw", "position.hub_pitch", "reference_rate.hub_pitch",
                         "rate.base_yaw", "tip.beam_positive"]}  # fmt: skip
    it = built(system=system, allow_unstable=True)
    pairs = [asked(k, 3) for k in range(30)]
    linear = CONTROLLERS["linear"].linear
    assert linear is not None
    form = linear(it.estimator, it.law, [reference for _, reference in pairs])
    assert form is not None
    assert isinstance(form.observer, LinearObserver)
    z, before, effort = np.zeros(3), None, np.zeros(2)
    for k, (measurement, reference) in enumerate(pairs):
        y = np.concatenate((measurement.joint_position, measurement.joint_velocity,
                            measurement.tip_deflection[:1]))  # fmt: skip
        if before is not None:
            z = (
                form.observer.state @ z
                + form.observer.demand @ effort
                + form.observer.before @ before
            )
        before = y
        demand = form.law.demand[k] + form.law.from_state @ z + form.law.from_output @ y
        limit = form.law.integration.limit
        effort = np.clip(demand, -limit, limit)
        np.testing.assert_allclose(
            it.law.update(measurement, SEEN.update(measurement), reference), effort, atol=1e-9
        )


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"system": {"d": (-D).tolist()}}, r"not stable .* spectral radius of one tick is 1\."),
        ({"system": {"d": D.tolist(), "period": 0.02}}, r"system\.period: 0\.02 s is not allowed"),
        ({"system": {"d": D[:1].tolist()}}, r"system\.d: give 2 rows of 4 numbers"),
        (
            {"system": {"d": D[:, :1].tolist(), "inputs": ["speed.base_yaw"]}},
            "system.inputs: speed",
        ),
        ({"system": {"d": D.tolist(), "outputs": ["effort.x", "effort.y"]}}, "system.outputs"),
        (
            {"system": {"d": D.tolist(), "outputs": ["effort.base_yaw", "base_yaw"]}},
            "system.outputs: base_yaw is there twice",
        ),
        ({"system": {"e": 1}}, "unknown key"),
        ({"file": "law.txt"}, "give a file that ends in"),
        ({"file": "nowhere.npz"}, "nowhere.npz: cannot be read"),
    ],
)
def test_what_does_not_fit_is_refused_in_one_line(settings: Any, words: str) -> None:
    with pytest.raises(BadInput, match=words) as refused:
        built(**settings)
    assert "\n" not in str(refused.value)


def test_an_unstable_loop_flies_where_it_is_allowed() -> None:
    built(system={"d": (-D).tolist()}, allow_unstable=True)


def told_the_efforts(share: float) -> dict[str, Any]:
    """Return an LQG of the csa that is told the applied efforts; a share of its observer's gain.

    Its estimate's error is moved by no effort. State: the last estimate and the last readings.
    """
    believed = {"modes": 1, "damping_ratio": 0.01}
    rest = rest_of(read_testbed({"kind": "csa", **believed}, "here"), {"hub_pitch": 0.0})
    model = sampled_plant(rest, PlantPath(0.01))
    a, b, c = model.a, model.b, model.c[:2]
    k = np.asarray(control.dlqr(a, b, c.T @ c + 1e-5 * np.eye(len(a)), 1e-6 * np.eye(2))[0])
    gain = share * control.dlqe(a, np.eye(len(a)), c, 1e-6 * np.eye(len(a)), 1e-6 * np.eye(2))[0]
    now = np.hstack((a - gain @ c, gain, np.zeros((len(a), 2)), b))  # of state and inputs
    after = np.vstack((now, np.hstack((np.zeros((2, len(a) + 2)), np.eye(2), np.zeros((2, 2))))))
    n = len(after)
    return {
        "model": believed,
        "operating_point": {"hub_pitch": 0.0},
        "system": {
            "a": after[:, :n].tolist(),
            "b": after[:, n:].tolist(),
            "c": (-k @ now[:, :n]).tolist(),
            "d": (-k @ now[:, n:]).tolist(),
            "period": 0.01,
            "inputs": [f"{kind}.{joint}" for kind in ("position", "applied")
                       for joint in ("base_yaw", "hub_pitch")],
        },
    }  # fmt: skip


def test_an_observer_whose_error_grows_is_not_stable_though_no_effort_moves_it() -> None:
    built(**told_the_efforts(1.0))
    with pytest.raises(BadInput, match=r"not stable on the model .* one tick is 1\.0"):
        built(**told_the_efforts(-0.05))
    wild = {**told_the_efforts(-0.05), "allow_unstable": True}
    what = trial("m1", {"plan": None, "testbed.modes": 1, "testbed.damping_ratio": 0.01,
                        "controllers": {"linear": wild}, "active": "linear"})  # fmt: skip
    found = loop_analysis(what, "it")
    assert not found.stable
    assert min(pole.damping for pole in found.poles) < 0.0


@pytest.mark.parametrize("ending", [".npz", ".mat"])
@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"D": (1.0 + 2.0j) * D}, "real numbers|cannot be read"),
        ({"D": D, "dt": 0.01}, "dt: call the period Ts"),
    ],
)
def test_numbers_and_periods_that_would_be_misread_are_refused(
    ending: str, values: dict[str, Any], words: str, tmp_path: Path
) -> None:
    path = tmp_path / f"law{ending}"
    if ending == ".mat":
        savemat(path, values)
    else:
        np.savez(path, **values)
    with pytest.raises(BadInput, match=words):
        with_file("linear", {"file": str(path)}, "here")


@pytest.mark.parametrize("law", ["linear", "collocated_pid", "proportional_integral"])
def test_an_anti_windup_that_is_faster_than_the_ticks_allow_is_refused(law: str) -> None:
    build_controller("it", law, {"tracking_time": 0.0051}, plant(), "here")
    with pytest.raises(BadInput, match=r"tracking_time: 0.005 is not allowed: above half a tick"):
        build_controller("it", law, {"tracking_time": 0.005}, plant(), "here")


def lead(filtered: float) -> dict[str, Any]:
    """Return a PD whose derivative has a filter of this time constant [s], as a system."""
    a = -np.eye(2) / filtered
    return {
        "a": a.tolist(),
        "b": np.hstack((np.eye(2), np.zeros((2, 2)))).tolist(),
        "c": ((460.0 - 920.0 / filtered) / filtered * np.eye(2)).tolist(),
        "d": np.hstack((920.0 / filtered * np.eye(2), np.zeros((2, 2)))).tolist(),
    }


@pytest.mark.parametrize(("filtered", "time"), [(1e-6, 2.0), (0.001, 0.02)])
def test_an_anti_windup_that_runs_away_at_the_limit_is_refused(
    filtered: float, time: float
) -> None:
    """Tustin's pole is near -1 there, and the anti-windup moves it beyond."""
    system = lead(filtered)
    with pytest.raises(BadInput, match=r"tracking_time: .* at its limit the state would grow"):
        built(system=system, tracking_time=time)
    built(system=system, tracking_time=None)
    built(system=lead(0.01), tracking_time=time)
