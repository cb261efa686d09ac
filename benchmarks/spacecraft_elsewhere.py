"""A 4 ms step of a free hub with as many coordinates in MuJoCo and Basilisk, where they are.

Neither is needed by the bench: install them beside it (`pip install --target FOLDER mujoco bsk`,
PYTHONPATH=FOLDER), else their figures are left out. Both fly eight hinged panels on a free hub:
rigid bodies on springs, 14 coordinates, as SCOLE-S with eight modes has.
"""

from collections.abc import Callable
from importlib.util import find_spec
from time import perf_counter
from typing import Any

_PANELS = 8
_PERIOD = 0.004  # [s]
_STEPS = 2000
_ROUNDS = 5


def figures() -> dict[str, float]:
    """Return the best of rounds, from Python.

    mujoco_step_us: mj_step with its Runge-Kutta method of order 4, 4 evaluations a step [us].
    basilisk_step_us: a run of many steps with its Runge-Kutta method of order 4, per step [us].
    """
    found = {}
    if find_spec("mujoco") is not None:
        found["mujoco_step_us"] = _best(_mujoco())
    if find_spec("Basilisk") is not None:
        found["basilisk_step_us"] = _best(_basilisk())
    return found


def _best(steps: Callable[[], None]) -> float:
    """Return microseconds per step of a function that takes _STEPS."""
    times = []
    for _ in range(_ROUNDS):
        began = perf_counter()
        steps()
        times.append(perf_counter() - began)
    return 1e6 * min(times) / _STEPS


def _mujoco() -> Callable[[], None]:
    import mujoco  # type: ignore[import-not-found]

    panels = "".join(
        f'<body pos="0 0 {0.2 * k}"><joint type="hinge" axis="1 0 0" stiffness="40" damping="0.2"/>'
        '<geom type="box" size="0.5 0.2 0.01" pos="0 0.4 0" mass="2"/></body>'
        for k in range(_PANELS)
    )
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><option timestep="{_PERIOD}" integrator="RK4" gravity="0 0 0">'
        '<flag contact="disable"/></option><worldbody><body><freejoint/>'
        f'<geom type="box" size="1 1 1" mass="900"/>{panels}</body></worldbody></mujoco>'
    )
    data = mujoco.MjData(model)
    data.qvel[3:6] = 0.1

    def steps() -> None:
        for _ in range(_STEPS):
            mujoco.mj_step(model, data)

    return steps


def _basilisk() -> Callable[[], None]:
    from Basilisk.simulation import (  # type: ignore[import-not-found]
        hingedRigidBodyStateEffector,
        spacecraft,
    )
    from Basilisk.utilities import SimulationBaseClass, macros  # type: ignore[import-not-found]

    simulation = SimulationBaseClass.SimBaseClass()
    process = simulation.CreateNewProcess("process")
    process.addTask(simulation.CreateNewTask("task", macros.sec2nano(_PERIOD)))
    hub = spacecraft.Spacecraft()
    hub.hub.mHub = 900.0
    hub.hub.IHubPntBc_B = [[600.0, 0.0, 0.0], [0.0, 600.0, 0.0], [0.0, 0.0, 600.0]]
    hub.hub.omega_BN_BInit = [[0.1], [0.1], [0.1]]
    kept: list[Any] = []
    for k in range(_PANELS):
        panel = hingedRigidBodyStateEffector.HingedRigidBodyStateEffector()
        panel.mass, panel.d, panel.k, panel.c = 2.0, 0.4, 40.0, 0.2
        panel.IPntS_S = [[0.5, 0.0, 0.0], [0.0, 0.5, 0.0], [0.0, 0.0, 0.5]]
        panel.r_HB_B = [[0.0], [0.5], [0.2 * k]]
        panel.dcm_HB = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
        panel.ModelTag = f"panel{k}"
        hub.addStateEffector(panel)
        kept.append(panel)
    simulation.AddModelToTask("task", hub)
    simulation.InitializeSimulation()
    done = 0

    def steps() -> None:
        nonlocal done
        done += _STEPS
        simulation.ConfigureStopTime(macros.sec2nano(done * _PERIOD))
        simulation.ExecuteSimulation()
        del kept[_PANELS:]  # they live as long as the simulation

    return steps


if __name__ == "__main__":
    for name, value in figures().items():
        print(f"{name:32s} {value:10.2f}")
