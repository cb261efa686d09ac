"""A plant in MuJoCo: a hub with a boom of rigid links, springs and dampers between them.

It needs the package mujoco, which is no part of the bench, and works like external_plant.py, whose
functions for the messages it uses.
"""

import json
import struct
from typing import Any

import mujoco
from external_plant import (
    DESCRIPTION,
    EFFORT,
    ERROR,
    HELLO,
    MEASUREMENT,
    RESET,
    SHUTDOWN,
    read,
    write,
)

LINKS, LENGTH = 6, 0.5  # of the boom; of each [-, m]
NUMBERS = {"hub_inertia": 100.0, "link_mass": 0.5, "stiffness": 40.0, "damping": 0.2}
SUBSTEPS = 10  # of the integration in a tick


def model_of(numbers: dict[str, float], period: float) -> Any:
    """Return the model: a hinge about z, and links that bend about z one after the other."""
    links, end = "", ""
    for k in range(LINKS):
        at = 0.3 if k == 0 else LENGTH
        links += f'<body name="link{k}" pos="{at} 0 0"><joint axis="0 0 1" type="hinge"'
        links += f' stiffness="{numbers["stiffness"]}" damping="{numbers["damping"]}"/>'
        links += f'<geom type="capsule" fromto="0 0 0 {LENGTH} 0 0" size="0.02"'
        links += f' mass="{numbers["link_mass"]}"/>'
        end += "</body>"
    tip = f'<site name="tip" pos="{LENGTH} 0 0"/>'
    inertia = numbers["hub_inertia"]
    return mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep="{period / SUBSTEPS}" gravity="0 0 0" integrator="RK4">
        <flag contact="disable"/></option><worldbody><body name="hub">
        <inertial pos="0 0 0" mass="50" diaginertia="{inertia} {inertia} {inertia}"/>
        <joint name="hub" axis="0 0 1" type="hinge"/>{links}{tip}{end}</body></worldbody>
        <actuator><motor joint="hub"/></actuator></mujoco>"""
    )


def tip_deflection(data: Any) -> float:
    """Return how far the tip is from the axis of the undeformed boom [m]."""
    x, y = data.site("tip").xpos[:2] - data.body("hub").xpos[:2]
    c, s = data.body("hub").xmat[0], data.body("hub").xmat[3]
    return float(c * y - s * x)


def main() -> None:
    """Answer the bench until it ends."""
    numbers, start = dict(NUMBERS), 0.0
    model = model_of(numbers, 0.01)
    data = mujoco.MjData(model)
    while (message := read()) is not None and message[0] != SHUTDOWN:
        kind, epoch, tick, body = message
        if kind == HELLO:
            hello = json.loads(body)
            if unknown := set(hello["parameters"]) - set(numbers):
                words = f"parameters: {min(unknown)}: allowed: {', '.join(numbers)}"
                write(ERROR, 0, 0, words.encode())
                continue
            numbers |= hello["parameters"]
            start = hello["initial"].get("hub", 0.0)
            model = model_of(numbers, hello["period"])
            data = mujoco.MjData(model)
            hub = {"name": "hub", "unit": "rad", "limit": 20.0, "initial": start}
            description = {"protocol": 1, "joints": [hub], "tips": [{"name": "boom", "unit": "m"}]}
            write(DESCRIPTION, 0, 0, json.dumps(description).encode())
            continue
        if kind == RESET:
            mujoco.mj_resetData(model, data)
            data.qpos[0] = start
        elif kind == EFFORT:
            data.ctrl[0] = struct.unpack("<d", body)[0]
            for _ in range(SUBSTEPS):
                mujoco.mj_step(model, data)
            tick += 1
        mujoco.mj_forward(model, data)
        numbers_out = (data.qpos[0], data.qvel[0], tip_deflection(data))
        write(MEASUREMENT, epoch, tick, struct.pack("<3d", *numbers_out))


if __name__ == "__main__":
    main()
