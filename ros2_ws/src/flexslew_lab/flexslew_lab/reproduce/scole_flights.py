"""The flights of SCOLE-S and the numbers of its table (Sung and Joo, section 4)."""

from functools import lru_cache
from importlib import resources
from typing import Any, NamedTuple

import numpy as np

from flexslew_lab.run.flight_log import FlightLog
from flexslew_lab.run.in_process import run_bench
from flexslew_lab.trial.trial import SavedPlan, Trial, plan_of_trial, set_up, trial_of_values
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.testbeds.contract import Pointing
from flexslew_plant.testbeds.spacecraft.units import UNITS
from flexslew_plant.yaml_data import load_yaml

UNIT = UNITS["slug_ft_lb"]
PLATFORM = ("roll", "pitch", "yaw")
TIP = ("mast_tip_x", "mast_tip_y", "mast_tip_z")
FORCES = ("x", "y", "z")


class ScoleFlight(NamedTuple):
    """What a run shows, at every tick."""

    time: Vector  # (k,) [s]
    effort: Matrix  # held before each tick, (k, joints) [N m or N]
    feedforward: Matrix  # of the plan, (ticks, joints) [N m or N]
    names: tuple[str, ...]  # of the joints
    roll: Matrix  # angle and rate about x, (k, 2) [rad, rad/s]
    attitude: Matrix  # error from the goal, (k, 3) [rad]
    turn: Matrix  # of the mast's tip, (k, 3) [rad]
    end: float  # of the manoeuvre [s]
    metrics: dict[str, Any]

    def efforts(self, names: tuple[str, ...]) -> Vector:
        """Return the growing integral of squared efforts (53), (k,) [(lb ft)^2 s or lb^2 s]."""
        columns = [self.names.index(name) for name in names]
        unit = UNIT.force if names == FORCES else UNIT.torque
        square = (self.effort[:, columns] / unit) ** 2
        intervals = np.diff(self.time, prepend=self.time[0])
        integral: Vector = np.cumsum(square.sum(axis=1) * intervals)
        return integral


def example_values(name: str, changes: dict[str, Any] | None = None) -> dict[str, Any]:
    """Return a shipped trial's file with some of its keys changed, nested sections key by key."""
    text = (resources.files("flexslew_lab") / "trials" / f"{name}.yaml").read_text()
    return _merged(load_yaml(text, name), changes or {})


def example_trial(name: str, changes: dict[str, Any] | None = None) -> Trial:
    """Return a shipped trial with some of its keys changed; see example_values."""
    return trial_of_values(example_values(name, changes), name)


def _merged(values: dict[str, Any], changes: dict[str, Any]) -> dict[str, Any]:
    out = dict(values)
    for key, change in changes.items():
        before = out.get(key)
        nested = isinstance(before, dict) and isinstance(change, dict)
        out[key] = _merged(before or {}, change) if nested else change
    return out


_SOFT = {"testbed": {"appendages": {"mast": {"stiffness": 0.9}}}}
_NOMINAL_MODEL = {"appendages": {"mast": {"stiffness": 1.0}}}
UNDAMPED: dict[str, Any] = {
    "testbed": {"appendages": {"mast": {"damping": {"alpha": 0.0, "beta": 0.0}}}},
    "plan": {"shaper_damping": 0.0},
}
_MORE_MODES = _merged(UNDAMPED, {"testbed": {"appendages": {"mast": {"shape": {"modes": 6}}}}})
# name: trial and what is changed in it
CASES: dict[str, tuple[str, dict[str, Any]]] = {
    "tracking (a)": ("scole_s_a", {}),
    "tracking (b)": ("scole_s_b", {}),
    "rigid hold": ("scole_s_rigid", {}),
    "open loop": ("scole_s_open", {}),
    "no damping (a), six modes": ("scole_s_a", _MORE_MODES),
    "no damping (b), six modes": ("scole_s_b", _MORE_MODES),
    "EI -10 % (a)": (
        "scole_s_a",
        {
            **_SOFT,
            "plan": {"model": _NOMINAL_MODEL},
            "controllers": {"output_feedback": {"model": _NOMINAL_MODEL}},
        },
    ),
    "EI -10 % open": ("scole_s_open", {**_SOFT, "plan": {"model": _NOMINAL_MODEL}}),
    # the second mode is not shaped: the tracking model swings on after the end
    "second frequency kept (a)": (
        "scole_s_a",
        {"plan": {"equal_frequencies": False, "swing_on": 5.6}},
    ),
}


@lru_cache
def simulate(case: str) -> ScoleFlight:
    """Return one of CASES, flown in process."""
    name, changes = CASES[case]
    return simulate_trial(example_trial(name, changes))


def simulate_trial(trial: Trial) -> ScoleFlight:
    """Return the flight of a spacecraft's trial with a plan."""
    assert trial.plan is not None
    assert not isinstance(trial.plan, SavedPlan)
    assert isinstance(trial.testbed, Pointing)
    bench, controllers = set_up(trial, trial.name)
    plan = plan_of_trial(trial)
    assert plan is not None
    for controller in controllers.values():
        controller.adopt(plan)
    seen = FlightLog(bench, plan)
    run_bench(bench, controllers, seen)
    position = np.array([row.position for row in seen.truth_log])
    velocity = np.array([row.velocity for row in seen.truth_log])
    effort = np.array([row.applied_effort for row in seen.truth_log])
    time = np.array([row.time for row in seen.truth_log])
    names = bench.model.joint_names
    goal = dict(zip(names, plan.position[-1].tolist(), strict=True))
    motion = trial.testbed.motions(position, velocity, goal)
    return ScoleFlight(
        time,
        effort,
        plan.effort,
        names,
        np.column_stack((motion.turned[:, 0], velocity[:, 3])),
        motion.attitude,
        motion.turns["mast"],
        plan.end,
        seen.metrics(),
    )
