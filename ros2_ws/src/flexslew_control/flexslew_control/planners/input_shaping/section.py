"""The `plan` section of input_shaping, and the shaper that it selects."""

from collections.abc import Sequence
from typing import Annotated, Any, Literal, NamedTuple, TypeAlias

from pydantic import Field

from flexslew_control.planners.attitude.attitude_goal import GoalKey
from flexslew_control.planners.input_shaping.shaped_modes import (
    Modes,
    ShapedMode,
    around,
    shaped_mode,
)
from flexslew_control.planners.input_shaping.shaper_choice import (
    ranking,
    reason,
    shaper_of,
    worst_residual,
)
from flexslew_control.planners.input_shaping.shapers import UNSHAPED, Shaper, ShaperName
from flexslew_control.planners.joint_trajectory import Points
from flexslew_control.shared_keys import DesignModel, Initial, Start
from flexslew_plant.errors import BadInput
from flexslew_plant.settings import Positive, section

Command: TypeAlias = Literal["cubic", "quintic", "sin2", "bang_bang"]
FileName: TypeAlias = Annotated[str, Field(min_length=1)]
_DURATION = 15.0
_SLEW_KEYS = {"goal": None, "duration": _DURATION, "command": "quintic"}


@section
class InputShaping:
    """A rigid command, or a given trajectory, convolved with impulses that leave modes at rest."""

    method: Literal["input_shaping"] = "input_shaping"
    model: DesignModel = None
    initial: Initial = None
    goal: GoalKey = None
    # points as joint_trajectory has them, shaped instead of a command to a goal; or a file with a
    # JointTrajectory
    trajectory: Points | FileName | None = None
    start: Start = 0.0
    duration: Positive = _DURATION  # duration of the command before shaping [s]
    command: Command = "quintic"  # profile before shaping
    # input shaper; auto: the one with the shortest delay of those that leave at most `tolerance`
    # over the intervals of the modes
    shaper: ShaperName | Literal["auto"] = "zv"
    # frequencies to shape [rad/s]; empty: those of the model with its joints held, of a trajectory
    # without efforts that kp and kd fly those of their loop, with its damping
    frequencies: tuple[Positive, ...] = ()
    damping: float = Field(default=0.0, ge=0.0, lt=1.0)  # damping ratio of the shaped modes [-]
    # modes to shape instead of `frequencies`, with the intervals that `identify` has found: its
    # list, or its file identified.yaml
    modes: Modes | FileName = ()
    # relative error of frequencies without an interval that auto covers [-]
    frequency_error: float = Field(default=0.1, ge=0.0, lt=1.0)
    # residual vibration that EI shapers and auto tolerate [-]
    tolerance: float = Field(default=0.05, gt=0.0, lt=0.5)
    negative: bool = False  # whether negative impulses are allowed

    def __post_init__(self) -> None:
        """Refuse keys that would be ignored.

        Raises:
            ValueError: in words for the section's reader.
        """
        if self.modes and (self.frequencies or self.damping):
            raise ValueError("modes: give them, or frequencies and damping; not both")
        if self.trajectory is not None:
            for key, default in _SLEW_KEYS.items():
                if getattr(self, key) != default:
                    raise ValueError(f"{key}: not with a trajectory; remove one of them")


class ShapedBy(NamedTuple):
    """The shaper of a section, and what the summary of a plan states of it."""

    shaper: Shaper
    modes: tuple[ShapedMode, ...]
    summary: dict[str, Any]

    @staticmethod
    def of(settings: InputShaping, own_modes: Sequence[tuple[float, float]]) -> "ShapedBy":
        """Return the shaper of a section; without any mode nothing is shaped.

        Args:
            settings: the section.
            own_modes: frequencies [rad/s] and damping ratios of the model, where it names none.

        Raises:
            BadInput: the shaper needs negative impulses that are not allowed.
        """
        modes = _modes(settings, own_modes)
        if not modes:
            shaper, choice = UNSHAPED, dict[str, Any](shaper="none")
        elif settings.shaper == "auto":
            candidates = ranking(modes, settings.tolerance, settings.negative)
            shaper = candidates[0].shaper
            choice = {
                "shaper": candidates[0].name,
                "shaper_choice": reason(candidates, settings.tolerance),
                "shaper_ranking": [
                    {
                        "shaper": one.name,
                        "delay": one.delay,
                        "smoothing": one.smoothing,
                        "residual": one.residual,
                    }
                    for one in candidates
                ],
            }
        else:
            shaper = shaper_of(settings.shaper, modes, settings.tolerance, settings.negative)
            choice = {"shaper": settings.shaper}
        summary = {
            **choice,
            "shaper_delay": shaper.duration,
            "shaper_residual": worst_residual(shaper, modes),
            "impulse_times": shaper.times.tolist(),
            "impulse_amplitudes": shaper.amplitudes.tolist(),
            "frequencies": [mode.frequency for mode in modes],
            "sensitivity": [
                row
                for mode in modes[:1]
                for row in shaper.sensitivity(mode.frequency, mode.damping, 0.3, 61).tolist()
            ],
        }
        return ShapedBy(shaper, modes, summary)


def _modes(
    settings: InputShaping, own_modes: Sequence[tuple[float, float]]
) -> tuple[ShapedMode, ...]:
    """Return the modes to shape; see InputShaping."""
    if isinstance(settings.modes, str):
        words = "give the modes; a file is read where the trial is read"
        raise BadInput(words, "plan", "modes", settings.modes)
    if settings.modes:
        return tuple(map(shaped_mode, settings.modes))
    named = [(frequency, settings.damping) for frequency in settings.frequencies]
    error = settings.frequency_error if settings.shaper == "auto" else 0.0
    return tuple(around(frequency, damping, error) for frequency, damping in named or own_modes)
