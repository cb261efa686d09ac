"""Keys that sections of laws and planners share, each described once."""

from typing import Annotated, Any, TypeAlias

from pydantic import Field

from flexslew_plant.known_joints import ByJoint
from flexslew_plant.settings import NonNegative, Positive

DesignModel: TypeAlias = Annotated[
    dict[str, Any] | None,
    Field(
        description="keys in which the design model differs from the testbed with one "
        "mode; null: none"
    ),
]
WholeModel: TypeAlias = Annotated[
    dict[str, Any] | None,
    Field(description="keys in which the design model differs from the testbed; null: none"),
]
Initial: TypeAlias = Annotated[
    ByJoint[float] | None,
    Field(
        description="joint positions at the start, at rest, by name [rad or m]; null: those of "
        "the testbed"
    ),
]
Start: TypeAlias = Annotated[
    NonNegative, Field(description="simulated time of the first tick of the plan [s]")
]
TrackingTime: TypeAlias = Annotated[
    Positive | None,
    Field(description="time constant T_t of the anti-windup [s], above half a tick; null: none"),
]
