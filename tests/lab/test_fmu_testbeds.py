"""FMUs as testbeds: flown, recorded, flown again, and refused where they are not as described."""

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.oscillating_module import cart_module, exact_step

from flexslew_lab.export.fmu.archive import fmu_of
from flexslew_lab.export.fmu.description import Version
from flexslew_lab.export.fmu.of_trial import fmu_of_trial
from flexslew_lab.export.plant_module import plant_module
from flexslew_lab.notebook import fly, trial
from flexslew_lab.replay.resim import resim
from flexslew_lab.trial.sources import read_trial
from flexslew_plant.errors import BadInput
from flexslew_plant.own_code import ANY_CODE, Untrusted
from flexslew_plant.testbeds import read_testbed

pytest.importorskip("fmpy")
pytestmark = pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler cc here")


@pytest.fixture(scope="module", params=[2, 3])
def cart(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("fmu") / f"cart{request.param}.fmu"
    path.write_bytes(fmu_of(cart_module(), request.param))
    return path


def keys(fmu: Path, **more: Any) -> dict[str, Any]:
    """Return a trial with the cart on its spring."""
    testbed = {
        "kind": "fmu",
        "file": str(fmu),
        "joints": {"cart": {"position": "position", "velocity": "velocity", "unit": "m"}},
        "actuators": {"cart": {"effort": "force", "limit": 1.0}},
        "tips": {"force": {"position": "pull[1]", "unit": "N"}},
    }
    return {
        "name": "cart",
        "duration": 4.0,
        "testbed": {**testbed, **more},
        "controllers": {"pd_feedforward": {"kp": 30.0, "kd": 3.0}},
    }


def test_a_loop_around_the_cart_is_that_of_its_matrices(cart: Path) -> None:
    flight = fly(trial(keys(cart)))
    state, step, effort = np.array([0.25, 0.0]), exact_step(), 0.0
    goal = flight["reference.cart"][0]
    for k, position in enumerate(flight["position.cart"]):
        assert position == pytest.approx(state[0], abs=1e-12)
        assert flight["tip.force"][k] == pytest.approx(effort, abs=1e-12)
        effort = float(np.clip(30.0 * (goal - state[0]) - 3.0 * state[1], -1.0, 1.0))
        state = step @ np.append(state, effort)


def test_it_is_flown_again_from_its_log_if_it_is_trusted(cart: Path, tmp_path: Path) -> None:
    file = shutil.copy(cart, tmp_path / "plant.fmu")
    flight = fly(trial(keys(Path(file))), tmp_path / "run")
    with pytest.raises(Untrusted, match=r"refused to run .*plant\.fmu \(.*SHA-256 [0-9a-f]{64}\)"):
        resim(tmp_path / "run" / "bag")
    again = resim(tmp_path / "run" / "bag", trust=ANY_CODE)
    assert again.identical
    assert flight["position.cart"].size == 401
    Path(file).write_bytes(fmu_of(cart_module()._replace(period=0.02), 3))
    with pytest.raises(BadInput, match="is another file, SHA-256"):
        resim(tmp_path / "run" / "bag", trust=ANY_CODE)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"file": "none.fmu"}, "none.fmu: cannot be read: No such file"),
        ({"file": __file__}, r"test_fmu_testbeds\.py: is no FMU: File is not a zip file"),
        ({"actuators": {"boom": {"effort": "force", "limit": 1.0}}}, "one for each joint"),
        ({"actuators": {"cart": {"effort": "forces", "limit": 1.0}}},
         "has no variable 'forces'; did you mean force"),
        ({"actuators": {"cart": {"effort": "position", "limit": 1.0}}}, "of causality output"),
        ({"joints": {"cart": {"position": "position", "velocity": "velocity"}}},
         "position is in m, the joint cart in rad"),
        ({"parameters": {"mass": 2.0}}, "has no variable 'mass'; of causality parameter: none"),
        ({"initial": {"cart": 0.1}}, r"name the variable that sets it, joints\.cart\.start"),
        ({"initial": {"boom": 0.1}}, "boom is not a joint of the testbed"),
        ({"brake_damping": [1.0, 1.0]}, "brake_damping: 2 entries for 1 joints"),
        ({"sha256": "0" * 64, "initial": {"cart": 0.25}}, "is another file, SHA-256"),
    ],
)  # fmt: skip
def test_what_is_not_in_the_fmu_is_refused(cart: Path, changes: dict[str, Any], words: str) -> None:
    with pytest.raises(BadInput, match=words) as error:
        fly(trial(keys(cart, **changes)))
    assert "\n" not in str(error.value)


def test_a_period_between_its_steps_is_refused_before_the_flight(cart: Path) -> None:
    if "cart3" not in cart.name:
        pytest.skip("FMI 2.0 states no step of the FMU's own")
    with pytest.raises(BadInput, match=r"steps by 0\.01 s; a period of 0\.015 s is no multiple"):
        fly(trial({**keys(cart), "period": 0.015}))


def test_what_needs_equations_is_refused(cart: Path) -> None:
    testbed = read_testbed(keys(cart)["testbed"], "t", ANY_CODE)
    assert testbed.initial == {"cart": 0.25}
    with pytest.raises(BadInput, match="black box without equations"):
        testbed.model().linearise(np.zeros(2))
    with pytest.raises(BadInput, match="change its `parameters`"):
        testbed.scaled(stiffness=1.1)
    plan = {"method": "input_shaping", "goal": {"cart": 0.5}}
    with pytest.raises(BadInput, match="name one with equations as the design model"):
        fly(trial({**keys(cart), "plan": plan}))


@pytest.mark.parametrize("version", [2, 3])
def test_m1_of_an_exported_plant_flies_as_m1(version: Version, tmp_path: Path) -> None:
    """The closed circle: written as an FMU, imported again, planned for with its own equations."""
    given, _ = read_trial("m1", ["duration=40.0"])
    path = tmp_path / "csa.fmu"
    path.write_bytes(fmu_of_trial(given, plant_module(given), version, ("linux64",)))
    joints = given.testbed.model().joint_names
    variables = {
        name: {"position": f"joint_position.{name}", "velocity": f"joint_velocity.{name}"}
        for name in joints
    }
    limits = zip(joints, given.testbed.effort_limit, strict=True)
    testbed = {
        "kind": "fmu",
        "file": str(path),
        "joints": variables,
        "actuators": {n: {"effort": f"effort.{n}", "limit": limit} for n, limit in limits},
        "tips": {"beam_positive": {"position": "tip_deflection.beam_positive"}},
    }
    model = {"kind": "csa", "variant": "complete", "modes": 1, "damping_ratio": 0.0}
    plan = {"method": "optimized_feedforward", "goal": {"base_yaw": 1.0, "hub_pitch": 0.5},
            "duration": 25.0, "track": "reference", "model": model}  # fmt: skip
    first, second = fly(given), fly(
        trial({"name": "again", "duration": 40.0, "testbed": testbed, "plan": plan,
               "controllers": {"pd_feedforward": {"kp": [460.0, 460.0], "kd": [920.0, 920.0]}}})
    )  # fmt: skip
    for name in ("position.base_yaw", "position.hub_pitch", "effort.base_yaw", "tip.beam_positive"):
        np.testing.assert_allclose(second[name], first[name], rtol=0.0, atol=1e-9, err_msg=name)
