"""Residues of given modes by least squares, and the slopes of what is left: variable projection.

Every output is linear in residues and initial conditions once frequencies and damping ratios are
given (Golub and Pereyra 1973):

    y_o(t) = a + b t + sum_a R0_oa iint u_a + sum_i sum_a R_ioa q_ia(t) + free motion of mode i,
    q_ia'' + 2 zeta_i w_i q_ia' + w_i^2 q_ia = u_a,

with the efforts u that were really applied, held over every tick, as input. They are known
exactly, so nothing is biased by the feedback that made them: the errors of the fit are the
sensors' noise alone (the direct method with the true noise model, Pintelon and Schoukens, chapter
9). A rate sensor sees the derivative with the same residues; a deflection has no rigid part. An
accelerometer sees q'' = u - 2 zeta w q' - w^2 q of every mode and the rigid acceleration: the
efforts reach it at once, by a matrix of their own (feedthrough), just before and just after a tick.

On all ticks every mode has S_ioa q_ia' in addition to R_ioa q_ia: a damping that couples the modes
turns their shapes complex, and without S their frequencies would be biased by its square (Ewins
2000, 2.7). No effort moves a bench at once, so the sum of S over the modes is 0. With it and with
feedthrough an acceleration has any response that is sampled, also of efforts that were not held.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from flexslew_lab.identification.modal.oscillators import Oscillator
from flexslew_lab.identification.modal.parameter_groups import (
    ParameterGroup,
    bias_columns,
    groups_of,
)
from flexslew_lab.identification.modal.parts import Part, SharedColumns
from flexslew_lab.identification.modal.projection import Projection
from flexslew_lab.identification.modal.regressors import RegressorSignals, Terms
from flexslew_lab.identification.modal.unknown_effort import (
    PieceColumns,
    PieceSlopes,
    PulseResponses,
    estimates,
    log_prior,
)
from flexslew_plant.arrays import Matrix, Vector

_ROUNDING = 1e-15  # of the largest eigenvalue


class ModalLeastSquares:
    """The separable problem of one record.

    Args:
        signals: of the experiment.
        noise: standard deviation of every output, (outputs,).
    """

    def __init__(self, signals: RegressorSignals, noise: Vector) -> None:
        self.signals, self.noise = signals, noise
        self.record, self.groups = signals.record, groups_of(signals.record)

    def solve(self, modes: tuple[Oscillator, ...], slopes: bool = True) -> "Solution":
        """Return the best residues for these modes and the residual.

        Args:
            modes: frequencies and damping ratios.
            slopes: whether those of the residual are needed, too.
        """
        terms = self.signals.terms(modes, slopes)
        bases: dict[tuple[object, ...], SharedColumns] = {}
        parts = []
        for group in self.groups:
            samples = tuple(self._samples(column).tobytes() for column, _, _ in self.rows(group))
            orders = tuple(order for _, order in group.columns)
            filters = self.signals.filters
            noise = () if filters is None else tuple(filters[k].tobytes() for k, _ in group.columns)
            kind = group.rigid, orders, self._ratio(group), samples, noise
            if kind not in bases:
                bases[kind] = self._basis(group, terms)
            parts.append(self._part(group, bases[kind], terms))
        if slopes and self.record.pieces is not None:
            parts = self._with_pieces(modes, parts)
        return Solution(self, modes, parts)

    def _samples(self, column: int) -> Matrix:
        """Return 1 where an output has a sample and 0 where it has none, (ticks + 1, 1) or (1,)."""
        known = self.record.known
        return np.ones(1) if known is None else known[:, column, None].astype(np.float64)

    def _weighed(self, column: int, weight: float, values: Matrix) -> Matrix:
        """Return rows of an output with its weight, 0 without a sample, and its noise white."""
        return self.signals.whitened(column, weight * self._samples(column) * values)

    def _with_pieces(self, modes: tuple[Oscillator, ...], parts: list[Part]) -> list[Part]:
        """Return the parts with the slopes by unknown efforts behind those by the modes."""
        pulses = PulseResponses(self.record, modes)
        sums = [self._piece_slopes(part, len(pulses.pieces.first)) for part in parts]
        for each in (PieceSlopes.project, PieceSlopes.add):
            for rows, pieces, block in pulses.blocks():
                for one in sums:
                    each(one, rows, pieces, block)
        return [part.with_pieces(*one.products()) for part, one in zip(parts, sums, strict=True)]

    def _piece_slopes(self, part: Part, count: int) -> PieceSlopes:
        """Return the slopes of a part by so many pieces, before any rows are added."""
        group, inputs = part.group, self.record.effort.shape[1]
        rows = [(which, w * self._samples(column)) for column, which, w in self.rows(group)]
        first = bias_columns(group)
        columns = PieceColumns(*part.basis.factors, part.basis.turned @ part.own, part.residual)
        inertia = part.weights[first : first + inputs] if group.rigid else None
        return PieceSlopes(columns, rows, inertia, part.of_modes, count)

    def _ratio(self, group: ParameterGroup) -> float:
        """Return the weight of a group's rate relative to its position."""
        has_position_and_rate = group.position >= 0 and group.rate >= 0
        return (
            float(self.noise[group.position] / self.noise[group.rate])
            if has_position_and_rate
            else 1.0
        )

    def rows(self, group: ParameterGroup) -> list[tuple[int, int, float]]:
        """Return column of the record, derivative and weight of each quantity of a group."""
        ratio = self._ratio(group)
        return [(column, order, ratio if order == 1 else 1.0) for column, order in group.columns]

    def _basis(self, group: ParameterGroup, terms: tuple[Terms, ...]) -> SharedColumns:
        rows = self.rows(group)
        phi = np.vstack(
            [
                self._weighed(column, w, self._matrix(group, terms[which], which))
                for column, which, w in rows
            ]
        )
        scale = np.sqrt(np.einsum("ij,ij->j", phi, phi))
        scale[scale == 0.0] = 1.0
        phi /= scale
        projection = Projection(phi)
        if not terms[0].slopes:
            empty = np.zeros((len(phi), 0))
            return SharedColumns(phi, scale, projection, empty, np.zeros((phi.shape[1], 0)))
        raw = np.vstack(
            [self._weighed(column, w, np.hstack(terms[which].slopes)) for column, which, w in rows]
        )
        along = projection.coordinates(raw)
        return SharedColumns(phi, scale, projection, raw - phi @ along, along)

    def _part(self, group: ParameterGroup, basis: SharedColumns, terms: tuple[Terms, ...]) -> Part:
        rows = self.rows(group)
        sigma = float(self.noise[rows[0][0]])
        y = np.concatenate(
            [
                self._weighed(column, w, terms[which].measured[:, column, None]).ravel()
                for column, which, w in rows
            ]
        )
        weights, residual = basis.projection.solve(y)
        c = weights / basis.scale
        of_modes = self._of_modes(c, terms[0].modes, group.acceleration >= 0)
        width, count = of_modes.shape[1], len(terms[0].slopes)  # two for each mode
        group_terms = np.zeros((basis.turned.shape[1], count))
        for k in range(count):
            group_terms[k * width : (k + 1) * width, k] = of_modes[k // 2]
        return Part(
            group,
            c,
            of_modes,
            sigma,
            basis,
            residual / sigma,
            group_terms.T @ (basis.turned.T @ residual) / sigma**2,
            group_terms.T @ basis.products @ group_terms / sigma**2,
            basis.along @ group_terms,
            group_terms,
        )

    def _of_modes(self, c: Vector, modes: tuple[Matrix, ...], free: bool) -> Matrix:
        """Return the weights of each mode's own columns, (modes, columns); see _matrix."""
        first = self.record.effort.shape[1] + 2
        count, width = len(modes), modes[0].shape[1] if modes else first
        lags = c[len(c) - max(count - (not free), 0) * (width - first) :]
        plain = c[len(c) - lags.size - count * first : len(c) - lags.size]
        found = np.zeros((count, width))
        found[:, :first] = plain.reshape(count, first)
        if free:
            found[:, first:] = lags.reshape(count, width - first)
        elif lags.size:
            found[:-1, first:] = lags.reshape(count - 1, width - first)
            found[-1, first:] = -found[:-1, first:].sum(axis=0)
        return found

    def residual_in_time(self, modes: tuple[Oscillator, ...], parts: list[Part]) -> Matrix:
        """Return measured minus fitted at the samples, 0 elsewhere, (ticks + 1, outputs)."""
        left = self.record.measured - self.fitted_in_time(modes, parts)
        return left if self.record.known is None else np.where(self.record.known, left, 0.0)

    def fitted_in_time(self, modes: tuple[Oscillator, ...], parts: list[Part]) -> Matrix:
        """Return what the fit gives tick by tick, (ticks + 1, outputs)."""
        terms = RegressorSignals(self.record, None).columns(modes)
        fitted = np.zeros_like(self.record.measured)
        for part in parts:
            group_terms = part.of_modes.shape[1]  # without rates where the fit has none
            for column, which, _ in self.rows(part.group):
                kept = tuple(mode[:, :group_terms] for mode in terms[which].modes)
                columns = self._matrix(part.group, terms[which]._replace(modes=kept), which)
                fitted[:, column] = columns @ part.weights
        return fitted

    def _matrix(self, group: ParameterGroup, group_terms: Terms, which: int) -> Matrix:
        """Return the columns of an order of derivative, 0 to 2: bias, rigid, then modes."""
        one = group_terms.constant
        if which == 0:
            bias = group_terms.line if group.rigid else one
            bias = np.hstack((bias, np.zeros_like(one))) if group.rate >= 0 else bias
        elif group.position >= 0:  # the derivative of the line, and the sensor's own bias
            bias = np.hstack((0.0 * one, self.signals.slope * one, one))
        else:
            bias = one
        rigid = [group_terms.rigid] if group.rigid else []
        first = self.record.effort.shape[1] + 2
        lags = [mode[:, first:] for mode in group_terms.modes]
        if which < 2:  # no effort moves a position at once
            lags = [one - lags[-1] for one in lags[:-1]]
        return np.hstack([bias, *rigid, *(mode[:, :first] for mode in group_terms.modes), *lags])


@dataclass(frozen=True)
class Solution:
    """Residues, residual and slopes for given modes."""

    problem: ModalLeastSquares
    modes: tuple[Oscillator, ...]
    parts: list[Part]

    @property
    def cost(self) -> float:
        """Half the squared residual, in standard deviations, with that of unknown efforts."""
        squares = sum(part.residual @ part.residual for part in self.parts)
        return float(0.5 * squares) + log_prior(self.problem.record)

    @property
    def information(self) -> Matrix:
        """J^T J of frequencies, damping ratios and unknown efforts, the residues eliminated."""
        total: Matrix = sum((p.information for p in self.parts[1:]), self.parts[0].information)
        if (pieces := self.problem.record.pieces) is not None:
            total = total + np.diag(
                np.concatenate((np.zeros(2 * len(self.modes)), 1.0 / pieces.spread**2))
            )
        return total

    @property
    def gradient(self) -> Vector:
        """Of the cost, downhill."""
        total: Vector = sum((p.gradient for p in self.parts[1:]), self.parts[0].gradient)
        if (pieces := self.problem.record.pieces) is not None:
            prior_gradient = (pieces.guess - estimates(self.problem.record)) / pieces.spread**2
            total = total + np.concatenate((np.zeros(2 * len(self.modes)), prior_gradient))
        return total

    @cached_property
    def covariance(self) -> Matrix:
        """Of frequencies, damping ratios and unknown efforts, where the record determines them."""
        information = self.information
        size = np.sqrt(np.maximum(np.diag(information), 0.0))
        size[size == 0.0] = 1.0
        scale = np.outer(size, size)
        values, vectors = np.linalg.eigh(information / scale)
        known = values > _ROUNDING * values.max(initial=0.0)  # the others may be negative
        scaled = vectors[:, known] / values[known] @ vectors[:, known].T
        return np.asarray(scaled / scale, dtype=np.float64)

    def residual_of(self, column: int) -> Vector:
        """Return measured minus fitted of an output, as its signals are cut, in its unit."""
        for part in self.parts:
            rows = len(part.residual) // len(self.problem.rows(part.group))
            if column in (part.group.position, part.group.acceleration):
                return np.asarray(part.residual[:rows] * self.problem.noise[column])
            if part.group.rate == column:
                # weighed to the first quantity's noise, so in its own standard deviations
                return np.asarray(part.residual[-rows:] * self.problem.noise[column])
        raise AssertionError(column)
