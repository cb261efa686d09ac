"""The sections of a task's file."""

from typing import Annotated, Any

from pydantic import Field

from flexslew_plant.settings import Positive, section


@section
class Term:
    """One metric of the score: weight / (1 + |metric| / half)."""

    weight: Positive  # its share of the score [-]; all of a task make 1
    half: Positive  # value that gives half of the weight, in the metric's unit


@section
class Requirement:
    """Bounds of a metric; a member outside of them has failed."""

    below: float | None = None  # in the metric's unit
    above: float | None = None  # in the metric's unit


@section
class TaskSettings:
    """The keys of a task's file."""

    task: Annotated[str, Field(pattern=r"^[a-z][a-z0-9-]*$")]  # its name, with hyphens
    version: Annotated[int, Field(ge=1)]  # of the task; one that is published is never changed
    trial: dict[str, Any]  # the nominal trial with the baseline controller and its plan
    # what differs from member to member, as in a study: by key of the trial a distribution
    vary: dict[str, dict[str, Any]]
    members: Annotated[int, Field(ge=2)] = 64  # of the development seeds, and of a round
    score: dict[str, Term]  # by metric
    require: dict[str, Requirement] = Field(default_factory=dict)  # by metric
