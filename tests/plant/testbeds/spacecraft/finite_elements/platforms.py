"""A floating platform that carries an appendage, on the bench and as a matrix."""

from typing import Any

import numpy as np
from tests.plant.testbeds.spacecraft.finite_elements.frames import Array

from flexslew_plant.testbeds import read_testbed

PLATFORM = {"mass": 6.0, "centre": [0.1, -0.05, 0.2],
            "inertia": {"xx": 2.0, "yy": 2.5, "zz": 3.0, "xy": 0.1}}  # fmt: skip
PLACE = [0.3, 0.2, -0.1]  # of the hinge, in body axes


def craft(shape: dict[str, Any], platform: dict[str, Any] = PLATFORM) -> Any:
    return read_testbed(
        {"kind": "spacecraft", "platform": platform, "units": "si",
         "actuators": {"turn": {"kind": "torque", "direction": [0, 0, 1], "limit": 1.0}},
         "appendages": {"arm": {"hinge": {"place": PLACE}, "shape": shape}}},
        "here",
    )  # fmt: skip


def free_frequencies(testbed: Any) -> Array:
    """Return what a floating spacecraft swings with, ascending [Hz]."""
    model = testbed.model()
    poles = model.linearise(model.rest({})).eigenvalues
    swings: Array = np.sort(poles.imag[poles.imag > 1e-2])
    return swings / (2.0 * np.pi)


def crossing(v: Array) -> Array:
    """Return the matrix of v x."""
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def platform_matrix(platform: dict[str, Any]) -> Array:
    """Return the mass matrix of a platform in displacements and rotations of the hinge, (6, 6)."""
    i = {"xy": 0.0, **platform["inertia"]}
    mass, centre = platform["mass"], np.array(platform.get("centre", [0.0, 0.0, 0.0]))
    inertia = np.array([[i["xx"], i["xy"], 0], [i["xy"], i["yy"], 0], [0, 0, i["zz"]]])
    body, cross = np.zeros((6, 6)), crossing(centre)
    body[:3, :3], body[3:, 3:] = mass * np.eye(3), inertia
    body[:3, 3:], body[3:, :3] = -mass * cross, mass * cross
    to_hinge = np.eye(6)  # motion of the body's origin by that of the hinge
    to_hinge[:3, 3:] = crossing(np.array(PLACE))
    matrix: Array = to_hinge.T @ body @ to_hinge
    return matrix
