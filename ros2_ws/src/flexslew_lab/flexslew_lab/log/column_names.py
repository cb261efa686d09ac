"""Names of the columns of a table: those of joints, modes and appendages in place of numbers."""

from flexslew_lab.log.bag_reader import Overview
from flexslew_lab.log.truth_columns import coordinate_of
from flexslew_plant.own_code import NO_CODE, Trust

_TICK_TOPICS = ("/truth", "/measurement", "/effort_command", "/controller_state")
_COORDINATES = (  # joints first, then modes
    "position",
    "velocity",
    "joint_position",
    "joint_velocity",
    "reference_position",
    "reference_velocity",
    "estimate_position",
    "estimate_velocity",
)
_ORIENTATIONS = ("reference_orientation", "estimate_orientation")
_PARTS = ("x", "y", "z", "w")  # of a quaternion
_EFFORTS = ("applied_effort", "disturbance", "effort", "feedforward", "estimate_disturbance")
_APPENDAGES = ("tip_deflection", "root_curvature")


def column_name(
    overview: Overview, topic: str, field: str, place: int, trust: Trust = NO_CODE
) -> str:
    """Return the name of one entry of a sequence: `position.hub`, else `position_0`.

    Args:
        overview: overview of the bag, with its testbed.
        topic: topic of the message.
        field: name of the sequence.
        place: index of the entry, from 0.
        trust: testbeds of the user's own that may be loaded for the names of their coordinates.
    """
    testbed = overview.testbed
    if topic == "/truth" and (known := coordinate_of(overview, field, place, trust)):
        return f"{field}.{known.name}"
    if testbed is not None and topic in _TICK_TOPICS:
        joints, appendages = tuple(testbed.joint_names), tuple(testbed.appendage_names)
        modes = tuple(f"mode_{k + 1}" for k in range(testbed.modes))
        names = {
            **dict.fromkeys(_COORDINATES, joints + modes),
            **dict.fromkeys(_EFFORTS, joints),
            **dict.fromkeys(_ORIENTATIONS, _PARTS),
            **dict.fromkeys(_APPENDAGES, appendages),
        }.get(field, ())
        if place < len(names):
            return f"{field}.{names[place]}"
    return f"{field}_{place}"
