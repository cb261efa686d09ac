"""A trial's loop on plants that differ from its own."""

from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.linalg import matrix_balance

from flexslew_control.analysis.loop import ControlLoop, loop_of
from flexslew_lab.analysis.analysis import Analysis, is_stable
from flexslew_lab.guarantee.box import Box
from flexslew_lab.guarantee.fit.polynomial import size_differs
from flexslew_lab.guarantee.model.parameters import (
    DEFAULT,
    Uncertain,
    Vary,
    box_of,
    loop_values,
    uncertain_parameters,
)
from flexslew_lab.guarantee.model.situation import Situation, situation_at
from flexslew_lab.guarantee.model.uncertain_loop import UncertainLoop
from flexslew_lab.trial.trial import Trial
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput


@dataclass(frozen=True)
class VariedLoop:
    """A trial's controller on plants that differ.

    Args:
        situation: of the trial.
        parameters: that differ.
        analysis: of the loop as it is: its law stays.
        scales: that balance the states, shape (states,).
    """

    situation: Situation
    parameters: tuple[Uncertain, ...]
    analysis: Analysis
    scales: Vector

    def at(self, values: Vector) -> ControlLoop:
        """Return the loop at values of the parameters, shape (m,)."""
        changes = loop_values(self.parameters, values)
        return loop_of(self.situation.changed(changes).plant, self.analysis.running.form)

    def matrix(self, values: Vector, pointing: bool = False) -> Matrix:
        """Return [[A, B], [C, D]] from the efforts' disturbance, its states balanced.

        Args:
            values: of the parameters, shape (m,).
            pointing: whether its outputs are the joint positions; else -T at the plant's input.

        Raises:
            BadInput: if the number of states is another one there.
        """
        loop, m, t = self.at(values), self.analysis.loop.efforts, self.scales
        closed, c, d = loop.closed, loop.closed.c[:m], loop.closed.d[:m, :m]
        if len(closed.a) != len(t):
            raise size_differs()
        if pointing:
            c, d = loop.joint_positions, np.zeros((len(loop.joint_positions), m))
        return np.block([[closed.a * t / t[:, None], closed.b[:, :m] / t[:, None]], [c * t, d]])

    def stable(self, values: Vector) -> bool:
        """Return whether the loop is stable at values of the parameters."""
        return is_stable(self.at(values))

    def over(self, box: Box, pointing: bool = False) -> UncertainLoop:
        """Return the uncertain loop over a box; outputs: see matrix."""
        exact = partial(self.matrix, pointing=pointing)
        return UncertainLoop(box, len(self.scales), exact, self.stable)


def varied_loop(trial: Trial, analysis: Analysis, vary: Vary) -> VariedLoop:
    """Return the loop of an analysis with uncertain parameters.

    Raises:
        BadInput: see uncertain_parameters.
    """
    situation = situation_at(trial, analysis.point)
    parameters = uncertain_parameters(situation, vary)
    box = box_of(parameters)
    changes = loop_values(parameters, box.centre)
    loop = loop_of(situation.changed(changes).plant, analysis.running.form)
    _, (scales, _) = matrix_balance(loop.closed.a, permute=False, separate=True)
    return VariedLoop(situation, parameters, analysis, np.asarray(scales, dtype=np.float64))


def default_vary(trial: Trial) -> Vary:
    """Return the ranges of an analysis: stiffness, and payload where the testbed carries one."""
    try:
        trial.testbed.scaled(payload=1.0 + DEFAULT["payload"])
    except BadInput:
        return {"stiffness": DEFAULT["stiffness"]}
    return DEFAULT
