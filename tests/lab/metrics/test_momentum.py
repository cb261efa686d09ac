"""What wheels store, against the angular momentum that they take from a craft at rest."""

import numpy as np
import pytest
from tests.lab.metrics.blocks import ticks_of

from flexslew_lab.metrics.metric import Block, Ending, ReferenceManoeuvre, RunSetup
from flexslew_lab.metrics.momentum import Momentum
from flexslew_lab.reproduce.scole_flights import example_trial
from flexslew_plant.testbeds import read_testbed
from flexslew_plant.testbeds.contract import Pointing as PointingTestbed

PERIOD = 0.02  # [s]


@pytest.mark.parametrize("seed", range(3))
def test_from_rest_wheels_store_what_the_craft_turns_with(seed: int) -> None:
    """Nothing acts from outside: h = -J w, with the inertia J of everything."""
    rng = np.random.default_rng(seed)
    axes = rng.standard_normal((4, 3))
    axes /= np.linalg.norm(axes, axis=1)[:, None]
    wheels = {
        f"wheel_{k}": {"axis": axis.tolist(), "inertia": 0.03, "limit": 0.5}
        for k, axis in enumerate(axes)
    }
    inertia = np.array([10.0, 14.0, 18.0])
    platform = {"inertia": dict(zip(("xx", "yy", "zz"), inertia.tolist(), strict=True))}
    craft = read_testbed(
        {"kind": "spacecraft", "platform": platform, "appendages": {}, "actuators": {},
         "wheels": wheels}, "here",
    )  # fmt: skip
    model = craft.model()
    x = np.concatenate((model.rest({}), np.zeros(model.coordinates)))
    states = [model.split(x)]
    efforts = rng.uniform(-0.5, 0.5, 4) * np.sin(0.1 * np.arange(250))[:, None]
    for effort in efforts:
        x = model.advance(x, effort, PERIOD)
        states.append(model.split(x))
    q, v = (np.array(part) for part in zip(*states, strict=True))
    count = len(v)
    time, none = np.arange(count, dtype=float) * PERIOD, np.zeros((count, 4))
    metric = Momentum(
        RunSetup(
            model.joint_names, ReferenceManoeuvre(0.0, 1.0, None, np.zeros(4)), np.ones(4), craft
        )
    )
    block = Block(
        np.arange(count), time, np.full(count, PERIOD), q, v, none, none[:, :0], None,
        time >= 0.0, time >= 1.0,
    )  # fmt: skip
    for first in range(0, count, 60):
        metric.add(ticks_of(block, first, first + 60))
    found = metric.result(Ending([], [], True))
    body = v[:, 3:6] * inertia
    assert found["peak_stored_momentum"] == pytest.approx(abs(body).max(axis=0), rel=1e-9)
    assert found["final_stored_momentum"] == pytest.approx(-body[-1], rel=1e-9)
    speeds = v[:, 6:10]
    assert list(found["peak_wheel_speed"].values()) == pytest.approx(abs(speeds).max(axis=0))
    changes = (np.diff(np.sign(speeds[time >= 1.0]), axis=0) != 0.0).sum(axis=0)
    assert list(found["wheel_zero_crossings"].values()) == changes.tolist()
    assert changes.any()


def test_a_wheel_at_rest_has_no_sign() -> None:
    """What rounding leaves of a speed is none that crosses zero."""
    wheel = {"w": {"axis": [1.0, 0.0, 0.0], "inertia": 0.03, "limit": 0.5}}
    craft = read_testbed({"kind": "spacecraft", "wheels": wheel, "actuators": {}}, "here")
    model = craft.model()
    for size, crossings in ((1e-12, 0), (1e-6, 6)):
        v = np.zeros((8, model.coordinates))
        v[:, -1 - model.modes] = [10.0, *(size * (-1.0) ** np.arange(7))]
        time, none = np.arange(8.0), np.zeros((8, 1))
        aim = ReferenceManoeuvre(0.0, 1.0, None, np.zeros(1))
        metric = Momentum(RunSetup(model.joint_names, aim, np.ones(1), craft))
        q = np.tile(model.rest({}), (8, 1))
        metric.add(
            Block(np.arange(8), time, np.ones(8), q, v, none, none[:, :0], None,
                  time >= 0.0, time >= 1.0)
        )  # fmt: skip
        found = metric.result(Ending([], [], True))
        assert found["peak_wheel_speed"] == {"w": pytest.approx(10.0)}
        assert found["wheel_zero_crossings"] == {"w": crossings}


def test_the_peak_of_a_gimbal_is_that_of_all_ticks() -> None:
    craft = example_trial("control_moment_gyros").testbed
    assert isinstance(craft, PointingTestbed)
    model = craft.model()
    v = np.random.default_rng(3).standard_normal((8, model.coordinates))
    time, none = np.arange(8.0), np.zeros((8, model.efforts))
    aim = ReferenceManoeuvre(0.0, 1.0, None, np.zeros(model.joints))
    metric = Momentum(RunSetup(model.joint_names, aim, np.ones(model.efforts), craft))
    q = np.tile(model.rest({}), (8, 1))
    block = Block(
        np.arange(8), time, np.ones(8), q, v, none, none[:, :0], None, time >= 0.0, time >= 1.0
    )
    for first in (0, 4):
        metric.add(ticks_of(block, first, first + 4))
    found = metric.result(Ending([], [], True))["peak_gimbal_angle"]
    assert found == {k: abs(angle).max() for k, angle in craft.spins(v).gimbals.items()}
    assert len(found) == 4
