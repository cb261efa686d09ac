"""Names and units of a spacecraft's coordinates, which are not those of its joints."""

from flexslew_plant.testbeds.model import Coordinate
from flexslew_plant.testbeds.spacecraft.assembly.craft import Spacecraft
from flexslew_plant.testbeds.spacecraft.equations import layout as at


def coordinates(spacecraft: Spacecraft) -> tuple[tuple[Coordinate, ...], tuple[Coordinate, ...]]:
    """Return the entries of q and of v before the modes; see layout."""
    q: list[Coordinate] = []
    v: list[Coordinate] = []
    if spacecraft.motion == at.FREE:
        q += [Coordinate(f"place_{axis}", "m") for axis in "xyz"]
        q += [Coordinate(f"quaternion_{axis}", "") for axis in "xyzw"]
        v += [Coordinate(f"body_{axis}", "m/s") for axis in "xyz"]
        v += [Coordinate(f"body_rate_{axis}", "rad/s") for axis in "xyz"]
    elif spacecraft.motion == at.PIVOT:
        q.append(Coordinate("pivot", "rad"))
        v.append(Coordinate("pivot", "rad/s"))
    angle_names = [f"{a.name}_hinge" for a in spacecraft.appendages if a.hinge == at.DRIVEN]
    angle_names += [f"{w.name}_wheel" for w in spacecraft.wheels]
    q += [Coordinate(name, "rad") for name in angle_names]
    v += [Coordinate(name, "rad/s") for name in angle_names]
    q += [Coordinate(f"{g.name}_gimbal_integral", "rad s") for g in spacecraft.gyros]
    v += [Coordinate(f"{g.name}_gimbal", "rad") for g in spacecraft.gyros]
    return tuple(q), tuple(v)
