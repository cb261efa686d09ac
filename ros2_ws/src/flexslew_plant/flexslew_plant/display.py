"""How the testbeds look: robot description, frames and the bent beams, as plain numbers."""

from typing import NamedTuple

import numpy as np

from flexslew_plant import csa
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.testbeds import Testbed

HEIGHT = 2.0  # of the hub above the floor [m]
POINTS = 21  # along each drawn appendage


class Frame(NamedTuple):
    """child in parent: translation [m] and unit quaternion (x, y, z, w)."""

    parent: str
    child: str
    translation: tuple[float, float, float]
    rotation: tuple[float, float, float, float]


class Scene:
    """Draws a testbed. Frames: world, base (turns with the yaw), hub (pitches in the base)."""

    def __init__(self, testbed: Testbed) -> None:
        self._kind = testbed.kind
        self._modes = testbed.modes
        if isinstance(testbed, csa.CsaTestbed):
            beam = csa.beam(testbed)
            self._radius, self._length = testbed.parameters.hub_radius, beam.length
            s = np.linspace(0.0, beam.length, POINTS)
            self._shapes = beam.shape(s)
        else:
            self._radius, self._length = 0.3, 2.0
            s = np.linspace(0.0, self._length, POINTS)
            self._shapes = np.tile((s / self._length) ** 2, (testbed.modes, 1))
        self._along = s + self._radius

    def frames(self, joints: Vector) -> list[Frame]:
        """Return the frames at these joint positions [rad or m]."""
        still = (0.0, 0.0, 0.0, 1.0)
        if self._kind == "floating_oscillator":
            return [
                Frame("world", "base", (float(joints[0]), 0.0, HEIGHT), still),
                Frame("base", "hub", (0.0, 0.0, 0.0), still),
            ]
        pitch = float(joints[1]) if joints.size > 1 else 0.0
        yaw = float(joints[0])
        return [
            Frame("world", "base", (0.0, 0.0, HEIGHT), (0.0, 0.0, np.sin(yaw / 2), np.cos(yaw / 2))),
            Frame("base", "hub", (0.0, 0.0, 0.0), (0.0, np.sin(pitch / 2), 0.0, np.cos(pitch / 2))),
        ]

    def beams(self, modes: Vector) -> list[Matrix]:
        """Return the centre line of each appendage in the hub frame, (POINTS, 3) [m]."""
        bend = modes @ self._shapes
        if self._kind == "floating_oscillator":
            end = self._length + float(modes[0])
            return [np.outer(np.linspace(0.0, 1.0, POINTS), (end, 0.0, 0.0))]
        flat = np.zeros(POINTS)
        return [
            np.column_stack((self._along, bend, flat)),
            np.column_stack((-self._along, -bend, flat)),
        ]

    def robot_description(self) -> str:
        """Return the URDF: base, hub and straight appendages; the bend is drawn by markers."""
        turning = "prismatic" if self._kind == "floating_oscillator" else "continuous"
        axis = "1 0 0" if turning == "prismatic" else "0 0 1"
        limit = '<limit lower="-1e3" upper="1e3" effort="1e6" velocity="1e3"/>'
        first, second = {
            "csa": ("base_yaw", "hub_pitch"),
            "floating_oscillator": ("mass", ""),
            "hub_with_appendages": ("hub", ""),
        }[self._kind]
        r, length = self._radius, self._length
        pitch = (
            f'<joint name="{second}" type="continuous"><parent link="base"/><child link="hub"/>'
            '<axis xyz="0 1 0"/></joint>'
            if second
            else '<joint name="hub_fixed" type="fixed"><parent link="base"/><child link="hub"/></joint>'
        )
        sides = (("beam_positive", 1.0), ("beam_negative", -1.0))
        beams = "".join(
            f'<link name="{name}"><visual><origin xyz="{sign * (r + length / 2)} 0 0"/><geometry>'
            f'<box size="{length} 0.02 0.4"/></geometry><material name="ghost">'
            '<color rgba="0.6 0.6 0.7 0.25"/></material></visual></link>'
            f'<joint name="{name}_clamp" type="fixed"><parent link="hub"/><child link="{name}"/></joint>'
            for name, sign in sides[: 1 if turning == "prismatic" else 2]
        )
        return (
            f'<?xml version="1.0"?><robot name="{self._kind}"><link name="world"/>'
            '<link name="base"><visual><origin xyz="0 0 -1.2"/><geometry>'
            f'<cylinder radius="{0.7 * r}" length="1.6"/></geometry><material name="steel">'
            '<color rgba="0.35 0.37 0.42 1"/></material></visual></link>'
            f'<link name="hub"><visual><geometry><box size="{2 * r} {1.2 * r} {0.8 * r}"/></geometry>'
            '<material name="gold"><color rgba="0.85 0.65 0.2 1"/></material></visual></link>'
            f'<joint name="{first}" type="{turning}"><parent link="world"/><child link="base"/>'
            f'<origin xyz="0 0 {HEIGHT}"/><axis xyz="{axis}"/>{limit if axis[0] == "1" else ""}'
            f"</joint>{pitch}{beams}</robot>"
        )
