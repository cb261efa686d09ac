"""A closed sampled loop as a linear fractional form over a box of parameters."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from flexslew_lab.analysis.separation import LinearPart, separated_parts
from flexslew_lab.guarantee.box import Box, halves
from flexslew_lab.guarantee.fit.dynamics_fit import DynamicsFit, dynamics_fit
from flexslew_lab.guarantee.fit.fractional import Fractional, fractional_over
from flexslew_lab.guarantee.scalings.delta_blocks import DeltaBlocks
from flexslew_lab.guarantee.scalings.frequency_cover import LoopChannels
from flexslew_plant.arrays import Matrix, Vector

_RIGID = 1e-9  # distance from the unit circle of a pole that the loop does not show


class GainLimit(NamedTuple):
    """A gain to be bounded: of the system from its inputs to its outputs.

    Args:
        bound: largest singular value allowed [-].
        complement: whether it is of one minus the system, as S of -T.
    """

    bound: float
    complement: bool = False

    def direct(self, d: Matrix) -> Matrix:
        """Return the feedthrough of the gain's system, D or I + D."""
        return np.eye(len(d)) + d if self.complement else d


@dataclass(frozen=True)
class UncertainLoop:
    """The closed sampled loop as a linear fractional form over a box.

    Args:
        box: of the parameters.
        states: number of states.
        exact: S = [[A, B], [C, D]] at values, shape (states + outputs, states + inputs).
        stable: whether the loop is, at values.
    """

    box: Box
    states: int
    exact: Callable[[Vector], Matrix]
    stable: Callable[[Vector], bool]

    def dynamics(self, values: Vector) -> Matrix:
        """Return A at values of the parameters, shape (states, states)."""
        return self.exact(values)[: self.states, : self.states]

    @cached_property
    def form(self) -> Fractional:
        """S over the box as a linear fractional form."""
        return fractional_over(self.exact, self.box)

    @cached_property
    def fit(self) -> DynamicsFit:
        """A over the box, without hidden motions."""
        return dynamics_fit(self.dynamics, self.box)

    def halves(self, axis: int) -> "list[UncertainLoop]":
        """Return the loop over both halves of its box, fitted again, across a parameter."""
        box = self.box
        return [replace(self, box=Box(*half)) for half in halves(box.centre, box.radius, axis)]

    def response(self, values: Vector, gain: GainLimit) -> LoopChannels:
        """Return the system of a gain, S or -T, at values of the parameters."""
        s, n = self.exact(values), self.states
        return LoopChannels(s[:n, :n], s[:n, n:], s[n:, :n], gain.direct(s[n:, n:]))


def channels_of(
    loop: UncertainLoop, gain: GainLimit | None = None, reduced: bool = True
) -> LoopChannels:
    """Return the loop from w to v over its box, the gain's channels last.

    Args:
        loop: over its box.
        gain: whose channels are a further full block, or None.
        reduced: whether rigid motions that no channel shows are left out.
    """
    form, n = loop.form, loop.states
    s = form.constant
    b, c, d = form.left[:n], form.right[:, :n], form.inner
    if gain is not None:
        direct = gain.direct(s[n:, n:])
        b = np.hstack((b, s[:n, n:]))
        c = np.vstack((c, s[n:, :n] / gain.bound))
        d = np.block([[d, form.right[:, n:]],
                      [form.left[n:] / gain.bound, direct / gain.bound]])  # fmt: skip
    if not reduced:
        return LoopChannels(s[:n, :n], b, c, d)
    return _reduced(LoopChannels(s[:n, :n], b, c, d))


def _reduced(whole: LoopChannels) -> LoopChannels:
    """Return the channels without poles on the circle, rigid motions that no channel shows."""
    part = LinearPart(whole.a, whole.b, whole.c)
    seen, _ = separated_parts(part, lambda z: abs(z) < 1.0 - _RIGID)
    return LoopChannels(*seen, whole.d) if len(seen.a) < len(whole.a) else whole


def structure(loop: UncertainLoop, gain: GainLimit | None = None) -> DeltaBlocks:
    """Return the blocks of the loop, and of a gain."""
    form = loop.form
    full = (form.error,) if any(form.error) else ()
    if gain is not None:
        rows, columns = form.constant.shape
        full = (*full, (columns - loop.states, rows - loop.states))
    return DeltaBlocks(form.sizes, full)
