"""SCOLE-S and the full-scale SCOLE of Sung and Joo as sections, in slugs, feet and pounds."""

from typing import Any

from flexslew_plant.testbeds.spacecraft.assembly.craft import Spacecraft
from flexslew_plant.testbeds.spacecraft.settings import (
    AppendageSettings,
    Beam,
    Body,
    Damping,
    Inertia,
    Platform,
)
from flexslew_plant.testbeds.spacecraft.testbed import SpacecraftTestbed

SMALL = {
    "mass": 67.0576,
    "inertia": Inertia(xx=56.4319, yy=423.132, zz=441.673, xz=-9.06164),
    "length": 10.0,
    "density": 0.0130767,
    "ei": 2670.1,
    "gj": 1585.0,
    "polar": 7.3642e-4,
    "tip": Body(
        mass=0.130819,
        centre=(1.44231, -2.5, 0.0),
        inertia=Inertia(xx=0.309694, yy=0.309694, zz=0.619387),
    ),
}
FULL = {
    "mass": 6366.46,
    "inertia": Inertia(xx=905443.0, yy=6789100.0, zz=7086601.0, xz=-145393.0),
    "length": 130.0,
    "density": 0.0955,
    "ei": 4e7,
    "gj": 4e7,
    "polar": 0.9089,
    "tip": Body(
        mass=12.42, centre=(18.75, -32.5, 0.0), inertia=Inertia(xx=4969.0, yy=4969.0, zz=9938.0)
    ),
}


def scole(n: dict[str, Any], modes: int = 8) -> Spacecraft:
    """Return a free SCOLE with these numbers, with a torque about each axis of the shuttle."""
    mast = Beam(
        length=n["length"],
        linear_density=n["density"],
        bending_stiffness=n["ei"],
        torsion_stiffness=n["gj"],
        polar_inertia=n["polar"],
        along=(0.0, 0.0, -1.0),
        modes=modes,
        tip_body=n["tip"],
    )
    damping = Damping(alpha=0.005, beta=0.005)
    appendage = AppendageSettings(shape=mast, damping=damping, geometric_stiffness=False)
    platform = Platform(mass=n["mass"], inertia=n["inertia"])
    return SpacecraftTestbed(
        units="slug_ft_lb", platform=platform, appendages={"mast": appendage}
    ).craft
