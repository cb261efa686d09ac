"""A plant in Basilisk: a free hub with two hinged panels, turned about its yaw axis.

It needs the package bsk, which is no part of the bench, and the messages of external_plant.py.
"""

import json
import math
import struct
from typing import Any

import external_plant as wire
import numpy as np
from Basilisk.architecture import bskLogging, messaging
from Basilisk.simulation import extForceTorque, hingedRigidBodyStateEffector, spacecraft
from Basilisk.utilities import SimulationBaseClass, macros

NUMBERS = {"hub_inertia": 100.0, "panel_mass": 10.0, "stiffness": 60.0, "damping": 0.6}
LENGTH, ROOT = 2.0, 0.5  # of a panel, and from the hub's centre to its hinge [m]
SUBSTEPS = 10  # of the integration in a tick
bskLogging.setDefaultLogLevel(bskLogging.BSK_ERROR)  # standard output carries the messages


class Plant:
    """The simulation, from rest."""

    def __init__(self, numbers: dict[str, float], period: float, yaw: float) -> None:
        self.tick, self.time, self.yaw = macros.sec2nano(period), 0, yaw
        self.simulation = SimulationBaseClass.SimBaseClass()
        process = self.simulation.CreateNewProcess("plant")
        process.addTask(self.simulation.CreateNewTask("step", self.tick // SUBSTEPS))
        self.hub = spacecraft.Spacecraft()
        self.hub.hub.IHubPntBc_B = (numbers["hub_inertia"] * np.eye(3)).tolist()
        self.hub.hub.sigma_BNInit = [[0.0], [0.0], [math.tan(0.25 * yaw)]]
        self.panels = [self._panel(side, numbers) for side in (1.0, -1.0)]
        torque, self.message = extForceTorque.ExtForceTorque(), messaging.CmdTorqueBodyMsg()
        torque.cmdTorqueInMsg.subscribeTo(self.message)
        self.hub.addDynamicEffector(torque)
        for model in (self.hub, torque, *self.panels):
            self.simulation.AddModelToTask("step", model)
        self.message.write(messaging.CmdTorqueBodyMsgPayload())
        self.simulation.InitializeSimulation()

    def _panel(self, side: float, numbers: dict[str, float]) -> Any:
        """Return a panel along x (or -x) whose hinge is about z; its axis h1 points to the hub."""
        panel = hingedRigidBodyStateEffector.HingedRigidBodyStateEffector()
        panel.mass = numbers["panel_mass"]
        across = panel.mass * LENGTH**2 / 12.0
        panel.IPntS_S = np.diag((0.01, across, across)).tolist()
        panel.d = 0.5 * LENGTH
        panel.k, panel.c = numbers["stiffness"], numbers["damping"]
        panel.r_HB_B = [[side * ROOT], [0.0], [0.0]]
        panel.dcm_HB = [[-side, 0, 0], [0, 0, 1], [0, side, 0]]
        self.hub.addStateEffector(panel)
        return panel

    def advance(self, torque: float) -> None:
        """Integrate a tick with a torque about yaw [N m]."""
        torques = [0.0, 0.0, torque]
        self.message.write(messaging.CmdTorqueBodyMsgPayload(torqueRequestBody=torques))
        self.time += self.tick
        self.simulation.ConfigureStopTime(self.time)
        self.simulation.ExecuteSimulation()

    def measurement(self) -> bytes:
        """Return yaw, its rate and the deflections of the panels' tips along their turn [m]."""
        state = self.hub.scStateOutMsg.read()
        yaw = 4.0 * math.atan(state.sigma_BN[2])
        self.yaw = yaw + 2.0 * math.pi * round((self.yaw - yaw) / (2.0 * math.pi))
        states = (self.hub.dynManager.getStateObject(p.nameOfThetaState) for p in self.panels)
        tips = [LENGTH * math.sin(one.getState()[0][0]) for one in states]
        return struct.pack("<4d", self.yaw, state.omega_BN_B[2], *tips)


def main() -> None:
    """Answer the bench until it ends."""
    numbers = dict(NUMBERS)
    while (message := wire.read()) is not None and message[0] != wire.SHUTDOWN:
        kind, epoch, tick, body = message
        if kind == wire.HELLO:
            hello = json.loads(body)
            if unknown := set(hello["parameters"]) - set(numbers):
                wire.write(wire.ERROR, 0, 0, f"unknown parameter {min(unknown)}".encode())
                continue
            numbers |= hello["parameters"]
            period, start = hello["period"], hello["initial"].get("yaw", 0.0)
            yaw = {"name": "yaw", "unit": "rad", "limit": 20.0, "initial": start}
            tips = [{"name": name, "unit": "m"} for name in ("right", "left")]
            description = {"protocol": 1, "joints": [yaw], "tips": tips}
            wire.write(wire.DESCRIPTION, 0, 0, json.dumps(description).encode())
            continue
        if kind == wire.RESET:
            plant = Plant(numbers, period, start)
        elif kind == wire.EFFORT:
            plant.advance(struct.unpack("<d", body)[0])
            tick += 1
        wire.write(wire.MEASUREMENT, epoch, tick, plant.measurement())


if __name__ == "__main__":
    main()
