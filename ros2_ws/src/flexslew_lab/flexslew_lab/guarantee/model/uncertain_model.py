"""The plant of a trial with uncertain parameters pulled out, for python-control and MATLAB."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy.io import savemat

from flexslew_control.analysis.lti import Lti
from flexslew_lab.analysis.trial_models import point_of
from flexslew_lab.guarantee.fit.fractional import Fractional, fractional_over
from flexslew_lab.guarantee.model.parameters import (
    Uncertain,
    Vary,
    box_of,
    loop_values,
    uncertain_parameters,
)
from flexslew_lab.guarantee.model.situation import situation_at
from flexslew_lab.trial.trial import Trial
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.notebook_table import in_notebook

if TYPE_CHECKING:
    import control


@dataclass(frozen=True, repr=False)
class UncertainModel:
    """Sampled plant M with w = Delta v around it: inputs (w, u), outputs (v, y).

    Args:
        lti: M, signals w.NAME.k and v.NAME.k first.
        parameters: with their ranges; delta is -1 at the low end and 1 at the high end.
        form: of [[A, B], [C, D]]; its `sizes` and `error` are the blocks of Delta.
    """

    lti: Lti
    parameters: tuple[Uncertain, ...]
    form: Fractional

    @property
    def system(self) -> "control.StateSpace":
        """M as python-control takes it."""
        return self.lti.state_space("uncertain")

    def at(self, **values: float) -> Lti:
        """Return the plant at values of its parameters; others are at the centres of their ranges.

        A dot in a name is an underscore here.

        Raises:
            BadInput: if a name is no parameter.
        """
        names = {p.name.replace(".", "_"): k for k, p in enumerate(self.parameters)}
        box, delta = box_of(self.parameters), np.zeros(len(self.parameters))
        for name, value in values.items():
            if name not in names:
                raise BadInput(f"no parameter {name!r}; allowed: {', '.join(names)}")
            k = names[name]
            delta[k] = (value - box.centre[k]) / box.radius[k]
        s, n = self.form.at(delta), len(self.lti.states)
        w, v = self.form.inner.shape[1], self.form.inner.shape[0]
        inputs, outputs = self.lti.inputs[w:], self.lti.outputs[v:]
        return Lti(s[:n, :n], s[:n, n:], s[n:, :n], s[n:, n:], inputs, outputs,
                   self.lti.states, self.lti.period)  # fmt: skip

    def save(self, path: Path | str) -> None:
        """Write M and the blocks of Delta to a .mat file.

        `blk` has a row for each block as MATLAB's Robust Control Toolbox takes it: [-r 0] for a
        real number that is repeated r times, [rows columns] for a full block.

        Raises:
            BadInput: if the name has another ending, or the file cannot be written.
        """
        target = Path(path)
        if target.suffix != ".mat":
            raise BadInput("give a name that ends in .mat", target)
        full = [list(self.form.error)] if any(self.form.error) else []
        blocks = [[-size, 0] for size in self.form.sizes if size] + full
        m = self.lti
        content = {
            "A": m.a, "B": m.b, "C": m.c, "D": m.d, "Ts": m.period, "blk": np.array(blocks, float),
            "parameters": np.array([p.name for p in self.parameters], dtype=object),
            "low": np.array([p.low for p in self.parameters]),
            "high": np.array([p.high for p in self.parameters]),
            "fit_error": self.form.largest_error,
            **{key: np.array(getattr(m, key), dtype=object)
               for key in ("inputs", "outputs", "states")},
        }  # fmt: skip
        try:
            savemat(target, content)
        except OSError as error:
            raise BadInput(f"cannot be written: {error.strerror}", target) from None

    def __repr__(self) -> str:
        """Return one line: states, and how often each parameter is repeated."""
        each = ", ".join(
            f"{p.name} x {size}" for p, size in zip(self.parameters, self.form.sizes, strict=True)
        )
        error = "exact" if self.form.exact else f"error {self.form.largest_error:.1e}"
        return f"<UncertainModel: {len(self.lti.states)} states, {each}, {error}>"

    def _repr_html_(self) -> str:
        """Return the parameters, for notebooks."""
        rows = (
            (p.name, f"{p.low:g}", f"{p.high:g}", size)
            for p, size in zip(self.parameters, self.form.sizes, strict=True)
        )
        return in_notebook(repr(self), ("parameter", "low", "high", "times"), rows)


def uncertain_model_of(trial: Trial, vary: Vary, at: float | str | None = None) -> UncertainModel:
    """Return the sampled plant of a trial, its applied efforts among the outputs, over ranges.

    Args:
        trial: what stands on the bench.
        vary: see uncertain_parameters.
        at: simulated time [s], see point_of.

    Raises:
        BadInput: if a parameter is not understood, or the states differ within the ranges.
    """
    situation = situation_at(trial, point_of(trial, at))
    parameters = uncertain_parameters(situation, vary)
    box = box_of(parameters)

    def plant(values: Vector) -> Lti:
        return situation.changed(loop_values(parameters, values)).plant

    def matrix(values: Vector) -> Matrix:
        p = plant(values)
        return np.block([[p.a, p.b], [p.c, p.d]])

    form = fractional_over(matrix, box)
    return UncertainModel(_pulled_out(plant(box.centre), form, parameters), parameters, form)


def _pulled_out(middle: Lti, form: Fractional, parameters: tuple[Uncertain, ...]) -> Lti:
    """Return M: the plant at the centre, with the channels of Delta before its own."""
    n, s = len(middle.a), form.constant
    names = [
        f"{p.name}.{k + 1}"
        for p, size in zip(parameters, form.sizes, strict=True)
        for k in range(size)
    ]
    w = [*names, *(f"error.{k + 1}" for k in range(form.error[0]))]
    v = [*names, *(f"error.{k + 1}" for k in range(form.error[1]))]
    return Lti(
        s[:n, :n],
        np.hstack((form.left[:n], s[:n, n:])),
        np.vstack((form.right[:, :n], s[n:, :n])),
        np.block([[form.inner, form.right[:, n:]], [form.left[n:], s[n:, n:]]]),
        (*(f"w.{name}" for name in w), *middle.inputs),
        (*(f"v.{name}" for name in v), *middle.outputs),
        middle.states,
        middle.period,
    )
