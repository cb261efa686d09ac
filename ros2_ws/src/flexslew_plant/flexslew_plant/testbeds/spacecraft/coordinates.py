"""Names and units of a spacecraft's coordinates, which are not those of its joints."""

from flexslew_plant.testbeds.model import Coordinate
from flexslew_plant.testbeds.spacecraft.assembly.craft import Spacecraft
from flexslew_plant.testbeds.spacecraft.equations import layout as at


def coordinates(craft: Spacecraft) -> tuple[tuple[Coordinate, ...], tuple[Coordinate, ...]]:
    """Return the entries of q and of v before the modes; see layout."""
    q: list[Coordinate] = []
    v: list[Coordinate] = []
    if craft.motion == at.FREE:
        q += [Coordinate(f"place_{axis}", "m") for axis in "xyz"]
        q += [Coordinate(f"quaternion_{axis}", "") for axis in "xyzw"]
        v += [Coordinate(f"body_{axis}", "m/s") for axis in "xyz"]
        v += [Coordinate(f"body_rate_{axis}", "rad/s") for axis in "xyz"]
    elif craft.motion == at.PIVOT:
        q.append(Coordinate("pivot", "rad"))
        v.append(Coordinate("pivot", "rad/s"))
    turning = [f"{a.name}_hinge" for a in craft.appendages if a.hinge == at.DRIVEN]
    turning += [f"{w.name}_wheel" for w in craft.wheels]
    q += [Coordinate(name, "rad") for name in turning]
    v += [Coordinate(name, "rad/s") for name in turning]
    q += [Coordinate(f"{g.name}_gimbal_integral", "rad s") for g in craft.gyros]
    v += [Coordinate(f"{g.name}_gimbal", "rad") for g in craft.gyros]
    return tuple(q), tuple(v)
