"""The sections of a study file."""

from typing import Annotated, Any, Literal, TypeAlias

from pydantic import Field

from flexslew_lab.studies.sampling.methods import Sampling
from flexslew_plant.settings import Positive, section

ModelSource: TypeAlias = Literal["experiment", "manoeuvre"] | bool
REPLAN, EXPERIMENT, MANOEUVRE = "replan", "experiment", "manoeuvre"

Confidence = Annotated[float, Field(gt=0.5, lt=1.0)]
Share = Annotated[float, Field(gt=0.0, lt=1.0)]


@section
class Criterion:
    """What a metric must satisfy; without a probability, in every trial."""

    below: float | None = None  # in the metric's unit
    above: float | None = None  # in the metric's unit
    probability: Share | None = None  # of keeping to it
    confidence: Confidence = 0.9  # with which that is to be shown


@section
class Stop:
    """When a quantile is known well enough to stop."""

    metric: str  # whose quantile
    quantile: Share = 0.99  # that is to be known
    half_width: Positive  # of its bounds, in the metric's unit
    confidence: Confidence = 0.9  # of its bounds


@section
class Keep:
    """What stays besides the table."""

    # worst N flies the worst trials again with their logs; none
    bags: Annotated[str, Field(pattern=r"^(none|worst [1-9][0-9]*)$")] = "worst 5"


@section
class StudySettings:
    """The keys of a study file; docs/studies/keys.md documents them one by one."""

    # its name, and that of its folder, runs/study-NAME
    study: Annotated[str, Field(pattern=r"^[A-Za-z0-9_.-]+$")]
    trial: str  # a shipped trial or a file
    seed: Annotated[int, Field(ge=0)] = 1  # of the samples and of every trial
    # `method`: random, lhs, sobol, grid, list, saltelli; `n`; `replicates` of lhs and sobol; `file`
    # of a list
    sampling: Sampling = Sampling()
    # by key of the trial: a distribution, or `relative` or `offset` and a distribution; `keys`
    # names several that follow one draw
    vary: dict[str, dict[str, Any]] = Field(default_factory=dict)
    # whether planner and controllers know the sampled bench; false: they believe in the nominal
    # one; `experiment`: what an experiment on the sampled bench finds; `manoeuvre`: what the log of
    # the manoeuvre finds that was planned for the nominal one. `compare: {replan: {nominal: false,
    # identified: experiment, truth: true}}` flies all three
    replan: ModelSource = False
    # keys that make the trial that experiment, with a `plan` of method excitation; its plan
    # believes the nominal bench
    shake: dict[str, Any] = Field(default_factory=dict)
    # numbers of the `testbed` section that the experiment fits, as `--fit` of `identify` does:
    # planner and controllers believe the bench's own equations with them; empty: they believe its
    # modes and inertias
    fit: tuple[str, ...] = ()
    # by key of the trial: a list of values, or values by name; every combination flies the same
    # samples
    compare: dict[str, list[Any] | dict[str, Any]] = Field(default_factory=dict)
    # by metric: `below` or `above`, and with `probability` and `confidence` what is to be shown;
    # without them, every trial must meet it
    criteria: dict[str, Criterion] = Field(default_factory=dict)
    # stop when the `quantile` of the `metric` is known to ± `half_width` at `confidence` (0.9)
    stop: Stop | None = None
    keep: Keep = Keep()  # `bags: worst N` flies the worst trials again with their logs; `none`
    limit: Positive = 600.0  # a trial that takes longer [s] of wall time has failed
    batch: bool = True  # whether one kernel may fly many trials at once
