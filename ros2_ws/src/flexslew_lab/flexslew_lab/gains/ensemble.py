"""What gains of a law do: worst figures over benches with errors, and the margin that they keep."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from hashlib import sha256
from typing import Any, NamedTuple

import numpy as np

from flexslew_control.analysis.linear_plant import sampled_plant
from flexslew_control.analysis.loop import loop_of
from flexslew_control.controllers import CONTROLLERS, build_controller, law_values
from flexslew_control.controllers.probing.running_law import running_law
from flexslew_lab.analysis.analysis import disk_margin
from flexslew_lab.analysis.trial_models import Point, point_of
from flexslew_lab.studies.cases import Case
from flexslew_lab.studies.execution.worker import Job, StudyRunner
from flexslew_lab.studies.flight import FlightResult, PlanCache
from flexslew_lab.studies.study import Study
from flexslew_lab.studies.study_settings import StudySettings
from flexslew_lab.studies.variants import StudyVariant
from flexslew_lab.studies.varied import SampledParameter
from flexslew_lab.trial.trial import Trial, law_of, plant_of
from flexslew_plant.errors import BadInput
from flexslew_plant.settings import plain

ERRORS = (0.8, 1.0, 1.2)  # of stiffness and of payload, as factors [-]
RESIDUAL, EFFORT = "residual_tip_deflection", "control_effort"  # metrics


class MemberOutcome(NamedTuple):
    """What one choice of gains does.

    Args:
        residual: largest deflection of a tip after the manoeuvre, over all benches [m].
        effort: largest integral of the squared efforts, over all benches.
        alpha: disk margin at the plant's input, of the nominal bench where the manoeuvre ends.
    """

    residual: float
    effort: float
    alpha: float


@dataclass(frozen=True)
class Gains:
    """Which numbers of a controller's section are gains, and what they are in the trial.

    Args:
        controller: its name in the trial.
        shipped: by key, what the trial has: a number, or one per joint.
    """

    controller: str
    shipped: dict[str, Any]

    def times(self, factors: Sequence[float]) -> dict[str, Any]:
        """Return the section's gains with each key multiplied, all joints of it alike."""
        return {
            key: [v * f for v in value] if isinstance(value, list) else value * f
            for (key, value), f in zip(self.shipped.items(), factors, strict=True)
        }


def gains_of(trial: Trial, source: str, controller: str | None, keys: Sequence[str] = ()) -> Gains:
    """Return the gains of a trial's controller.

    Args:
        trial: the bench and the manoeuvre.
        source: its file, for messages.
        controller: which; None: the one in charge.
        keys: of its section; none: those that its law names as gains.

    Raises:
        BadInput: no such controller, no manoeuvre, or no such gains.
    """
    name = controller or trial.active
    if name not in trial.controllers:
        known = ", ".join(trial.controllers)
        raise BadInput(f"{source}: --controller: {name} is not in controllers; allowed: {known}")
    if trial.plan is None:
        raise BadInput(f"{source}: plan: there is no manoeuvre to find gains for")
    law, settings = law_of(name, trial.controllers[name] or {})
    if law not in CONTROLLERS:
        raise BadInput(f"{source}: --controller: {name} is no built-in law; allowed: those of docs")
    section = plain(CONTROLLERS[law].settings(**law_values(settings)))
    positive = [key for key, value in section.items() if _positive(value)]
    requested = tuple(keys) or CONTROLLERS[law].batch_gains
    if not requested or not set(requested) <= set(positive):
        requested_names = ", ".join(requested) or "none"
        raise BadInput(
            f"{source}: --gain: {requested_names}; positive numbers of {law}: {', '.join(positive)}"
        )
    return Gains(name, {key: section[key] for key in requested})


def _positive(value: Any) -> bool:
    if isinstance(value, list):
        return bool(value) and all(_positive(part) for part in value)
    return isinstance(value, int | float) and not isinstance(value, bool) and value > 0.0


class GainEnsemble:
    """The benches on which gains are tried, at their manoeuvre.

    Args:
        trial: the nominal one.
        source: its file, for messages.
        gains: what is varied.
    """

    def __init__(self, trial: Trial, source: str, gains: Gains) -> None:
        self._trial, self._source, self._gains = trial, source, gains
        settings = {name: trial.controllers[name] for name in (gains.controller,)}
        quiet = [entry for entry in trial.schedule if entry.switch is None]
        self._base = plain(trial) | {
            "controllers": settings, "active": gains.controller, "fallback": [],
            "schedule": plain(quiet),
        }  # fmt: skip
        self._benches = list(_scaled(trial))
        self._point: Point = point_of(trial, at=trial.duration)
        self._plans = PlanCache()

    @property
    def identity(self) -> str:
        """Of everything that a choice is tried on, as a hash."""
        whole = json.dumps([self._base, self._benches], sort_keys=True)
        return sha256(whole.encode()).hexdigest()

    def outcomes(self, choices: Sequence[Sequence[float]]) -> list[MemberOutcome]:
        """Return the outcomes of choices of factors on the gains; NaN where nothing flies.

        Those with a loop that is not stable are not flown.
        """
        alphas = [self._alpha(factors) for factors in choices]
        stable = [k for k, alpha in enumerate(alphas) if alpha > 0.0]
        all_results = self._simulate_choices([choices[k] for k in stable])
        out = [MemberOutcome(np.nan, np.nan, alpha) for alpha in alphas]
        for k, results in zip(stable, all_results, strict=True):
            out[k] = MemberOutcome(_worst(results, RESIDUAL), _worst(results, EFFORT), alphas[k])
        return out

    def _section(self, factors: Sequence[float]) -> dict[str, Any]:
        settings = self._trial.controllers[self._gains.controller] or {}
        return {**settings, **self._gains.times(factors)}

    def _alpha(self, factors: Sequence[float]) -> float:
        """Return the disk margin at the plant's input; 0: not stable."""
        name = self._gains.controller
        law, values = law_of(name, self._section(factors))
        plant = plant_of(self._trial)
        try:
            built = build_controller(name, law, values, plant, self._source)
        except BadInput:  # it does not hold even what it believes
            return 0.0
        form = running_law(built, self._point.rest, plant.effort_limit).form
        plant_ticks = sampled_plant(self._point.rest, self._point.path, applied=True)
        return disk_margin(loop_of(plant_ticks, form))

    def _simulate_choices(self, choices: Sequence[Sequence[float]]) -> list[list[FlightResult]]:
        """Return the flights on all benches, by choice."""
        key = f"controllers.{self._gains.controller}"
        variants = tuple(
            StudyVariant(str(k), {key: self._section(factors)}) for k, factors in enumerate(choices)
        )
        bench = SampledParameter("testbed", ("testbed",), "absolute", None)
        settings = StudySettings(study="gains", trial=self._source)
        study = Study(settings, self._source, self._source, self._base, (bench,), variants, (), {})
        cases = [
            Case(k * len(self._benches) + j, j, k, self._trial.seed, (testbed,))
            for k in range(len(choices))
            for j, testbed in enumerate(self._benches)
        ]
        found: list[list[FlightResult]] = [[] for _ in choices]

        def report(results: list[FlightResult]) -> None:
            for one in results:
                found[one.number // len(self._benches)].append(one)

        StudyRunner(Job(study, self._plans)).fly(cases, report)
        return found


def _scaled(trial: Trial) -> list[dict[str, Any]]:
    """Return the testbeds of the ensemble as plain data, the nominal one among them."""
    out = []
    for stiffness in ERRORS:
        for payload in ERRORS:
            try:
                out.append(plain(trial.testbed.scaled(stiffness, payload)))
            except BadInput:  # it carries none
                if payload == 1.0:
                    out.append(plain(trial.testbed.scaled(stiffness)))
    return out


def _worst(results: Sequence[FlightResult], metric: str) -> float:
    """Return the largest of a metric, all of its parts; NaN where a flight failed."""
    worst = 0.0
    for one in results:
        parts = [v for key, v in one.metrics.items() if key.split(".")[0] == metric]
        if one.status != "ok" or not parts or None in parts:
            return float("nan")
        worst = max(worst, *(abs(float(v)) for v in parts if v is not None))
    return worst
