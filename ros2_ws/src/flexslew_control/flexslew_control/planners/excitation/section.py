"""The `plan` section of an excitation."""

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from flexslew_control.planners.excitation.signals import Phases
from flexslew_control.planners.slew import Feedback
from flexslew_control.shared_keys import Initial, Start, WholeModel
from flexslew_plant.settings import NonNegative, PerJoint, Positive, section


@section
class Excitation:
    """Joints are shaken about their positions, so that a model can be identified."""

    goal: ClassVar[dict[str, float]] = {}  # no joint goes anywhere

    method: Literal["excitation"] = "excitation"
    # kind of the shaking
    signal: Literal["multisine", "chirp", "random_binary", "impulse"] = "multisine"
    model: WholeModel = None
    initial: Initial = None
    joints: tuple[str, ...] | None = None  # names of the joints that are shaken; null: all
    # lowest and highest frequency [rad/s]; null: 0.4 times the lowest to 2.5 times the highest of
    # the model
    band: tuple[Positive, Positive] | None = None
    # distance of two lines of the multisine [rad/s]; null: four periods in each experiment
    resolution: Positive | None = None
    # a line's size goes with its frequency to this power [-]
    slope: Annotated[float, Field(ge=-4.0, le=4.0)] = 0.0
    phases: Phases = "optimised"  # of the lines: optimised for the smallest peak, schroeder, random
    # peak of the shaking, for all joints or each [N m or N]; null: the largest within the three
    # limits below
    amplitude: PerJoint | None = None
    # largest effort with the feedback, as a part of the limit [-]
    effort_share: Annotated[float, Field(gt=0.0, le=1.0)] = 0.5
    largest_excursion: PerJoint = (0.02,)  # of a joint, for all or each [rad or m]
    # largest deflection of a tip that the model predicts [m]; null: no limit
    largest_tip: Positive | None = None
    taper: NonNegative = 5.0  # rise and fall at the ends [s]
    start: Start = 0.0
    duration: Positive = 600.0  # of all of it [s]
    seed: Annotated[int, Field(ge=0)] = 1  # of what is random
    # gains `kp` and `kd` that fly it; null: those of the controller in charge
    feedback: Feedback | None = None
