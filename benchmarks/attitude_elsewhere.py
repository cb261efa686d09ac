"""The attitude of one craft after 1,000 s here and in Basilisk, where that is.

A rigid hub with one reaction wheel under a constant torque, in the gravity gradient of a circular
orbit. Install Basilisk beside the bench (`pip install --target FOLDER bsk`, PYTHONPATH=FOLDER).
"""

from importlib.util import find_spec
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from flexslew_plant.bench.bench import Bench, BenchSettings
from flexslew_plant.measurement import EffortCommand
from flexslew_plant.testbeds import read_testbed
from flexslew_plant.testbeds.spacecraft.orbit import GRAVITY, RADIUS

_LASTING, _PERIOD = 1000.0, 0.1  # [s]
_ALTITUDE, _PHASE = 500e3, 0.5  # [m, rad]
_INERTIA = (10.0, 16.0, 20.0)  # [kg m^2]
_AXIS, _WHEEL, _TORQUE = (0.6, 0.0, 0.8), 0.05, 2e-5  # of the wheel [-, kg m^2, N m]


def figures() -> dict[str, float]:
    """Return the difference.

    basilisk_attitude_difference_rad: the angle between the two attitudes after 1,000 s [rad].
    basilisk_attitude_turn_rad: how far the craft has turned by then [rad].
    """
    if find_spec("Basilisk") is None:
        return {}
    here, there = _here(), _basilisk()
    return {
        "basilisk_attitude_difference_rad": float((here.inv() * there).magnitude()),
        "basilisk_attitude_turn_rad": float(here.magnitude()),
    }


def _here() -> Rotation:
    x, y, z = _INERTIA
    testbed = read_testbed(
        {
            "kind": "spacecraft",
            "platform": {"mass": 50.0, "inertia": {"xx": x, "yy": y, "zz": z}},
            "appendages": {},
            "actuators": {},
            "wheels": {"wheel": {"axis": list(_AXIS), "inertia": _WHEEL, "limit": 1.0}},
            "orbit": {"altitude": _ALTITUDE, "phase": _PHASE},
        },
        "benchmark",
    )
    bench = Bench(BenchSettings(testbed=testbed, period=_PERIOD, duration=_LASTING + 1.0))
    for _ in range(round(_LASTING / _PERIOD)):
        asked, effort = bench.question, np.array([_TORQUE])
        bench.offer(EffortCommand(asked.tick, asked.epoch, asked.controller, effort))
        bench.advance()
    return Rotation.from_quat(bench.truth().position[3:7])


def _basilisk() -> Rotation:
    from Basilisk.architecture import messaging  # type: ignore[import-not-found]
    from Basilisk.simulation import (  # type: ignore[import-not-found]
        GravityGradientEffector,
        reactionWheelStateEffector,
        spacecraft,
    )
    from Basilisk.utilities import (  # type: ignore[import-not-found]
        SimulationBaseClass,
        macros,
        simIncludeGravBody,
        simIncludeRW,
    )

    simulation = SimulationBaseClass.SimBaseClass()
    process = simulation.CreateNewProcess("process")
    process.addTask(simulation.CreateNewTask("task", macros.sec2nano(_PERIOD)))
    hub = spacecraft.Spacecraft()
    hub.ModelTag = "craft"
    hub.hub.mHub = 50.0
    hub.hub.IHubPntBc_B = np.diag(_INERTIA).tolist()
    distance = RADIUS + _ALTITUDE
    speed = float(np.sqrt(GRAVITY / distance))
    c, d = float(np.cos(_PHASE)), float(np.sin(_PHASE))
    hub.hub.r_CN_NInit = [[distance * c], [distance * d], [0.0]]
    hub.hub.v_CN_NInit = [[-speed * d], [speed * c], [0.0]]
    bodies = simIncludeGravBody.gravBodyFactory()
    earth = bodies.createEarth()
    earth.mu, earth.isCentralBody = GRAVITY, True
    bodies.addBodiesTo(hub)
    gradient = GravityGradientEffector.GravityGradientEffector()
    gradient.ModelTag = "gradient"
    gradient.addPlanetName(earth.planetName)
    hub.addDynamicEffector(gradient)
    wheels = simIncludeRW.rwFactory()
    kept: Any = wheels.create(
        "custom", list(_AXIS), Js=_WHEEL, Omega=0.0, useMaxTorque=False, useMinTorque=False,
        Omega_max=1e4,
    )  # fmt: skip
    effector = reactionWheelStateEffector.ReactionWheelStateEffector()
    wheels.addToSpacecraft("wheels", effector, hub)
    torque = messaging.ArrayMotorTorqueMsgPayload()
    torque.motorTorque = [-_TORQUE]  # of the motor on the wheel
    command = messaging.ArrayMotorTorqueMsg().write(torque)
    effector.rwMotorCmdInMsg.subscribeTo(command)
    for model in (effector, gradient, hub):
        simulation.AddModelToTask("task", model)
    log = hub.scStateOutMsg.recorder()
    simulation.AddModelToTask("task", log)
    simulation.InitializeSimulation()
    simulation.ConfigureStopTime(macros.sec2nano(_LASTING))
    simulation.ExecuteSimulation()
    del kept
    return Rotation.from_mrp(np.array(log.sigma_BN)[-1])


if __name__ == "__main__":
    for name, value in figures().items():
        print(f"{name:36s} {value:.3e}")
