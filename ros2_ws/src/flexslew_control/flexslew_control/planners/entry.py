"""The entry of a planner in the table of planners, which the planner's file defines."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Protocol, TypeAlias

from flexslew_control.law import ActiveLaw, PlantDescription
from flexslew_control.plan import Plan
from flexslew_control.planners.progress import Progress, ignore
from flexslew_control.planners.slew import Feedback
from flexslew_plant.entries import default_of
from flexslew_plant.own_code import Trust


class PlanSection(Protocol):
    """A `plan` section of any method."""

    @property
    def method(self) -> str:
        """Name of the planner, or where the class of the user's own stands."""

    @property
    def start(self) -> float:
        """When the manoeuvre begins [s]."""


class PlanTask(NamedTuple):
    """What a plan is made of; see make_plan."""

    settings: Any  # the `plan` section
    plant: PlantDescription
    feedback: Feedback | None = None  # gains of the active controller; None: it has no such gains
    progress: Progress = ignore  # called with every update of an iteration
    law: ActiveLaw | None = None  # that is active; None: not known


Make: TypeAlias = Callable[[PlanTask], Plan]


class Variant(NamedTuple):
    """A way to use a planner that is compared in addition to its defaults."""

    name: str  # behind that of the planner
    keys: Mapping[str, Any]  # of its section
    duration_factor: float = 1.0  # than the slew of the trial [-]


@dataclass(frozen=True)
class PlannerEntry:
    """A planner as the rest of the bench uses it.

    Args:
        settings: its `plan` section; the default of `method` is its name.
        make: returns the plan of a section; see slewing.SlewPlanner.
        slews: whether it takes joints to a goal.
        feedforward: whether its plans have one.
        takes_duration: whether the slew takes the `duration` of its section; else the planner
            finds it, or adds to it.
        compared: keys of its section where it is compared with other methods.
        variants: compared too.
        example: keys of its section for a plan that is made quickly, where its defaults take long.
        with_files: returns a section with what its files hold in place of their names, of the
            section, the source to name in an error and the trust.
        instead: returns the entry that plans a section in place of this one; None: this one does.
        by_law: keys that each law of a comparison sets as it needs them (LawEntry.plans), with the
            values for a law that sets none; None if one plan serves every law.
    """

    settings: type[Any]
    make: Make
    slews: bool = True
    feedforward: bool = True
    takes_duration: bool = False
    compared: Mapping[str, Any] = field(default_factory=dict)
    variants: tuple[Variant, ...] = ()
    example: Mapping[str, Any] = field(default_factory=dict)
    by_law: Mapping[str, Any] | None = None
    with_files: Callable[[Any, str, Trust], Any] = lambda settings, source, trust: settings
    instead: Callable[[Any], "PlannerEntry | None"] = lambda settings: None

    @property
    def name(self) -> str:
        """The name in `plan.method`."""
        return default_of(self.settings, "method")
