"""The search for gains: Optuna's sampler over all of the range, then smaller and smaller steps."""

import logging
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from flexslew_lab.gains.ensemble import GainEnsemble, Gains, MemberOutcome
from flexslew_lab.short_values import short
from flexslew_plant.errors import BadInput
from flexslew_plant.notebook_table import in_notebook

if TYPE_CHECKING:
    import optuna

_BATCH = 8  # choices that are flown at once
_STEPS = tuple(2.0**-k for k in range(2, 8))  # in the last part, of an octave
_PENALTY = 10.0  # in the logarithm of the residual, for all of the margin
_LOST = 1e3  # logarithm of the residual where nothing flies


class GainEvaluation(NamedTuple):
    """A choice that was tried: factors on the shipped gains, and what they do."""

    factors: tuple[float, ...]
    outcome: MemberOutcome


@dataclass(frozen=True, repr=False)
class FoundGains:
    """What a search has found.

    Args:
        gains: what was varied.
        least: disk margin that had to be kept.
        shipped: what the trial's own gains do.
        best: the smallest worst residual of those that keep it.
        tried: all of them, the first first.
    """

    gains: Gains
    least: float
    shipped: MemberOutcome
    best: GainEvaluation
    tried: tuple[GainEvaluation, ...]

    def __repr__(self) -> str:
        """Return one line: what is gained over the gains of the trial."""
        return f"<FoundGains of {self.gains.controller}: {self.verdict}>"

    def _repr_html_(self) -> str:
        """Return the trial's gains and the best ones, with what they do, for notebooks."""
        ones = (1.0,) * len(self.gains.shipped)
        rows = (
            (name, *map(short, self.gains.times(factors).values()), *map(short, outcome))
            for name, factors, outcome in (
                ("in the trial", ones, self.shipped),
                ("found", *self.best),
            )
        )
        header = ("worst residual [m]", "worst effort", "disk margin")
        return in_notebook(repr(self), ("", *self.gains.shipped, *header), rows)

    @property
    def verdict(self) -> str:
        """In a sentence what is gained over the gains of the trial."""
        words = (
            f"worst residual {self.best.outcome.residual:.4g} m instead of "
            f"{self.shipped.residual:.4g} m: {100.0 * self.gain:.1f} % less"
        )
        if self.gain <= 0.0:
            words = f"nothing better than the trial's own gains, {self.shipped.residual:.4g} m"
        return f"{words}, at a disk margin of at least {self.least:.4g}"

    @property
    def front(self) -> tuple[GainEvaluation, ...]:
        """Those than which none has both a smaller residual and a larger margin."""
        best, out = np.inf, []
        for one in sorted(self.tried, key=lambda one: -one.outcome.alpha):
            if one.outcome.residual < best:
                best = one.outcome.residual
                out.append(one)
        return tuple(out)

    @property
    def changes(self) -> dict[str, Any]:
        """The best gains by path of the trial, for `trial(..., changes)`."""
        best = self.gains.times(self.best.factors)
        return {f"controllers.{self.gains.controller}.{key}": gain for key, gain in best.items()}

    def plain(self) -> dict[str, Any]:
        """Return it as plain data."""
        best = self.gains.times(self.best.factors)
        return {
            "controller": self.gains.controller,
            "least_disk_margin": self.least,
            "shipped": {"gains": self.gains.shipped, **self.shipped._asdict()},
            "best": {"gains": best, **self.best.outcome._asdict()},
            "gain": self.gain,
            "trials": len(self.tried),
            "front": [
                {"gains": self.gains.times(one.factors), **one.outcome._asdict()}
                for one in self.front
            ],
        }

    @property
    def gain(self) -> float:
        """How much smaller the worst residual is than that of the shipped gains [-]."""
        return 1.0 - self.best.outcome.residual / self.shipped.residual


def search_gains(
    ensemble: GainEnsemble,
    gains: Gains,
    trials: int = 200,
    octaves: float = 2.0,
    least: float | None = None,
    journal: Path | None = None,
    seed: int = 1,
    progress: Callable[[int, int], None] = lambda done, last: None,
) -> FoundGains:
    """Return the gains with the smallest worst residual that keep a disk margin.

    Args:
        ensemble: on which they are tried.
        gains: what is varied.
        trials: how many choices are tried, those of a journal among them.
        octaves: each key is multiplied by 2^-octaves to 2^octaves.
        least: disk margin at the plant's input that is to be kept; None: that of the shipped gains.
        journal: a file in which every choice is noted, and from which a search goes on; None: none.
        seed: of the sampler.
        progress: called with the choices tried, and how many there will be.

    Raises:
        BadInput: the journal is of another search, no choice keeps the margin, or nothing rings.
    """
    import optuna

    logging.getLogger("optuna").setLevel(logging.WARNING)
    shipped = ensemble.outcomes([[1.0] * len(gains.shipped)])[0]
    if shipped.residual == 0.0:
        raise BadInput("plan: no tip rings after this manoeuvre: no gains leave less; give another")
    margin = shipped.alpha if least is None else least
    description = {
        "gains": gains.shipped,
        "controller": gains.controller,
        "ensemble": ensemble.identity,
        "octaves": octaves,
        "least": margin,
    }
    study = _study(journal, description)
    done = [
        _trial_result(one) for one in study.get_trials(states=(optuna.trial.TrialState.COMPLETE,))
    ]
    study.sampler = optuna.samplers.TPESampler(
        seed=seed + len(done), multivariate=True, constant_liar=True, n_startup_trials=32
    )
    span = {key: optuna.distributions.FloatDistribution(-octaves, octaves) for key in gains.shipped}
    while len(done) < trials:
        count = min(_BATCH, trials - len(done))
        if len(done) >= trials // 2:
            for point in _near_points(done, margin, octaves, count):
                study.enqueue_trial(dict(zip(span, point, strict=True)))
        suggestions = [study.ask(span) for _ in range(count)]
        factors = [tuple(2.0 ** one.params[key] for key in span) for one in suggestions]
        outcomes = ensemble.outcomes(factors)
        for one, outcome in zip(suggestions, outcomes, strict=True):
            one.set_user_attr("outcome", [float(value) for value in outcome])
            study.tell(one, _cost(outcome, margin))
        done += [GainEvaluation(*pair) for pair in zip(factors, outcomes, strict=True)]
        progress(len(done), trials)
    keeping = [one for one in done if _has_margin(one.outcome, margin)]
    if not keeping:
        raise BadInput(f"--margin: none of {trials} choices keeps a disk margin of {margin:.4g}")
    best = min(keeping, key=lambda one: one.outcome.residual)
    return FoundGains(gains, margin, shipped, best, tuple(done))


def _study(journal: Path | None, description: dict[str, Any]) -> "optuna.Study":
    """Return a new study, or that of the journal.

    Raises:
        BadInput: the journal is none, or of another search.
    """
    import optuna
    from optuna.storages import JournalStorage
    from optuna.storages.journal import JournalFileBackend

    if journal is None:
        return optuna.create_study()
    try:
        storage = JournalStorage(JournalFileBackend(str(journal)))
        study = optuna.create_study(storage=storage, study_name="gains", load_if_exists=True)
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise BadInput(f"is no journal of a search: {error}", journal) from None
    known = study.user_attrs.get("about")
    if known is None and not study.trials:
        study.set_user_attr("about", description)
    elif known != description:
        raise BadInput("is the journal of another search; name another file", journal)
    return study


def _trial_result(one: "optuna.trial.FrozenTrial") -> GainEvaluation:
    factors = tuple(2.0**value for value in one.params.values())
    return GainEvaluation(factors, MemberOutcome(*one.user_attrs["outcome"]))


def _has_margin(outcome: MemberOutcome, margin: float) -> bool:
    return bool(outcome.alpha >= margin * (1.0 - 1e-9) and np.isfinite(outcome.residual))


def _cost(outcome: MemberOutcome, margin: float) -> float:
    """Return what the sampler minimises: the residual's logarithm, and what the margin lacks."""
    if not (np.isfinite(outcome.residual) and outcome.residual > 0.0):
        return _LOST
    margin_violation = max(0.0, 1.0 - outcome.alpha / margin)
    return float(np.log(outcome.residual) + _PENALTY * margin_violation)


def _near_points(
    done: Sequence[GainEvaluation], margin: float, octaves: float, count: int
) -> Iterator[list[float]]:
    """Yield up to `count` new points about the best one, in octaves, at the largest step left."""
    known = {_rounded(np.log2(one.factors)) for one in done}
    keeping = [one for one in done if _has_margin(one.outcome, margin)]
    if not keeping:
        return
    best = np.log2(min(keeping, key=lambda one: one.outcome.residual).factors)
    directions = np.array(np.meshgrid(*[(-1.0, 0.0, 1.0)] * best.size)).reshape(best.size, -1).T
    left = count
    for step in _STEPS:
        for direction in directions:
            point = np.clip(best + step * direction, -octaves, octaves)
            if left and _rounded(point) not in known:
                known.add(_rounded(point))
                left -= 1
                yield point.tolist()


def _rounded(point: Any) -> tuple[float, ...]:
    return tuple(np.round(np.asarray(point, dtype=np.float64), 9).tolist())
