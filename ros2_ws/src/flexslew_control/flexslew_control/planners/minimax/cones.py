"""A program with some of its rows, as Clarabel solves it.

The unknowns are the weights in units of the drives' limits, the residual g, the amplitudes of the
modes where nothing damps them, and inside a Trust the share that is missed.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import clarabel
import numpy as np
from scipy import sparse

from flexslew_control.planners.minimax.program import ConeProgram, Infeasible, Optimum, ProgramKey
from flexslew_control.planners.minimax.response import Indices
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import PlanFailed

_LIMIT_MARGIN = 1e-4  # of the limit of a drive, by which its rows keep below it [-]
_STEP_TOLERANCE = 1e-6  # what a step may miss its rows by, in the units of the program [-]
_REFINED = 1e-8  # residual of the linear equations of such a step, in the same units [-]
_ACTIVE_DUAL = 1e-7  # of the largest dual variable, above which a row holds a solution up


@dataclass
class ConeRows:
    """Rows a z <= b of a program, as they are gathered."""

    size: int
    slopes: list[Matrix] = field(default_factory=list)
    bounds: list[Vector] = field(default_factory=list)
    keys: list[ProgramKey | None] = field(default_factory=list)

    def add(self, slopes: Matrix, bounds: Vector, keys: Sequence[ProgramKey] = ()) -> None:
        """Add rows, shape (k, size) and (k,); fewer columns are the first ones."""
        self.keys += keys or [None] * len(slopes)
        padded = np.zeros((len(slopes), self.size))
        padded[:, : slopes.shape[1]] = slopes
        self.slopes.append(padded)
        self.bounds.append(bounds)

    @property
    def all(self) -> tuple[Matrix, Vector]:
        """All rows."""
        if not self.slopes:
            return np.zeros((0, self.size)), np.zeros(0)
        return np.vstack(self.slopes), np.concatenate(self.bounds)


class Cones:
    """One program with the rows that it has by now, in units in which all is about one."""

    def __init__(self, program: ConeProgram, feasible_only: bool, accuracy: float = 1e-8) -> None:
        self.program, self.feasible_only, self.accuracy = program, feasible_only, accuracy
        grid = program.grid
        self.unit = np.tile(program.limits.demand, grid.pieces)  # of the weights
        self.g = grid.size  # column of the residual
        modes = [len(r.rest.modes) // 2 for r in program.responses]
        self.cones = program.no_damping and not feasible_only
        self.ticks_count = not program.no_damping and not feasible_only  # for the residual
        self.first_mode = self.g + 1 + np.cumsum([0, *modes])
        self.size = int(self.first_mode[-1]) if self.cones else self.g + 1
        self.slack = self.size  # column of what is missed
        self.size += program.trust is not None
        self.rows = ConeRows(self.size)
        self.residual_rows = ConeRows(self.size)  # with a unit residual in the column g
        # of the residual [m]: the way, so that solutions scale with it; a step has flights to judge
        self.scale = program.span if program.trust is None else 1.0
        self.least = 1e-12 * self.scale  # of those that follow [m]
        self.held: tuple[ProgramKey, ...] = ()  # rows that held up the last solution
        self._equations()
        self._fixed_rows()

    def _equations(self) -> None:
        nominal = self.program.responses[0]
        slope, offset = nominal.path.end
        rows = self.program.end_error(slope) * self.unit
        values = -self.program.end_error(offset)
        if self.program.trust is None:
            self.equations = rows, values
            return
        self.equations = rows[:0], values[:0]
        for side in (1.0, -1.0):
            self._add_soft(side * rows, side * values)

    def _add_soft(self, rows: Matrix, bounds: Vector, keys: Sequence[ProgramKey] = ()) -> None:
        """Add rows with bounds that may be passed where there is a Trust."""
        padded = np.zeros((len(rows), self.size))
        padded[:, : self.g] = rows
        padded[:, self.slack :] = -1.0
        self.rows.add(padded, bounds, keys)

    def _fixed_rows(self) -> None:
        grid = self.program.grid
        one = np.eye(grid.size)
        trust = self.program.trust
        for side in (1.0, -1.0):
            most = np.full(grid.size, 1.0 - _LIMIT_MARGIN)
            if trust is not None:
                most = np.minimum(most, side * trust.about / self.unit + trust.radius)
            self.rows.add(side * one, most)

    def add(self, member: int, channel: int, ticks: Indices, side: float) -> None:
        """Add side * channel(k) <= its limit at some ticks of a member."""
        response = self.program.responses[member]
        slopes, offsets = response.rows(ticks, channel)
        low, high, sizes = self.program.limits.of(response.tips)
        limit, size = (low if side < 0.0 else high)[channel], sizes[channel]
        bounds = (side * limit - side * offsets) / size
        if response.tips <= channel < response.tips + self.program.grid.joints:
            bounds -= _LIMIT_MARGIN
        keys = [ProgramKey(member, channel, int(tick), side) for tick in ticks]
        self._add_soft(side * slopes * self.unit / size, bounds, keys)

    def add_residual(
        self, member: int, channel: int, ticks: Indices, sides: Sequence[float] = (1.0, -1.0)
    ) -> None:
        """Add side * tip(k) <= g at some ticks after the end, |tip(k)| <= g by both sides."""
        slopes, offsets = self.program.responses[member].rows(ticks, channel)
        keys = [ProgramKey(member, channel, int(tick), 0.0) for tick in ticks]
        for side in sides:
            padded = np.zeros((len(slopes), self.size))
            padded[:, : self.g] = side * slopes * self.unit
            padded[:, self.g] = -1.0
            self.residual_rows.add(padded, -side * offsets, keys)

    def solve(self) -> tuple[Vector, float, float]:
        """Return the weights, a lower bound of the objective [m], and the share that is missed.

        Raises:
            Infeasible: no efforts keep to the rows.
        """
        a, b, kinds = [], [], []

        def put(rows: Matrix, bounds: Vector, kind: object) -> None:
            a.append(rows)
            b.append(bounds)
            kinds.append(kind)

        rows, values = self.equations
        put(np.pad(rows, ((0, 0), (0, self.size - self.g))), values, clarabel.ZeroConeT(len(rows)))
        rows, bounds = self.rows.all
        residual, offsets = self.residual_rows.all
        scaled = residual / self.scale
        scaled[:, self.g] = residual[:, self.g]
        positive = -np.eye(self.size)[[self.g, *range(self.slack, self.size)]]
        every = np.vstack((rows, scaled, positive))
        none = np.zeros(len(positive))
        put(every, np.concatenate((bounds, offsets / self.scale, none)), _nonnegative(len(every)))
        if self.cones:
            self._put_cones(put)
        p = np.zeros(self.size)
        objective = np.zeros(self.size)
        if not self.feasible_only:
            p[: self.g] = 2.0 * self.program.rho * self.unit**2 / self.scale
            objective[self.g] = 1.0
        if self.program.trust is not None:
            objective[self.slack] = self.program.trust.price / self.scale
        settings = clarabel.DefaultSettings()
        settings.verbose = False
        settings.max_iter = 200
        settings.max_threads = 1
        settings.direct_solve_method = "qdldl"  # up to twice as fast here
        settings.tol_gap_abs = settings.tol_gap_rel = self.accuracy
        if self.program.trust is not None:  # its solution is flown and judged anyway
            settings.tol_feas = _STEP_TOLERANCE
            settings.iterative_refinement_reltol = settings.iterative_refinement_abstol = _REFINED
        found = clarabel.DefaultSolver(
            sparse.diags(p, format="csc"),
            objective,
            sparse.csc_matrix(np.vstack(a)),
            np.concatenate(b),
            kinds,
            settings,
        ).solve()
        status = found.status
        if status in (
            clarabel.SolverStatus.PrimalInfeasible,
            clarabel.SolverStatus.AlmostPrimalInfeasible,
        ):
            raise Infeasible("no efforts within the limits lead to the goal in this time")
        weights = np.array(found.x[: self.g]) * self.unit
        if not np.isfinite(weights).all():
            raise PlanFailed(f"the convex program was not solved: {status}")
        violation = float(sum(found.x[self.slack :]))
        multipliers = np.array(found.z)[len(self.equations[0]) :]
        keys = self.rows.keys + self.residual_rows.keys
        active = multipliers[: len(keys)] > _ACTIVE_DUAL * (1.0 + multipliers.max())
        self.held = tuple({k for k, h in zip(keys, active, strict=True) if k and h})
        return weights, max(float(found.obj_val_dual), 0.0) * self.scale, max(violation, 0.0)

    def cost(self, found: Optimum) -> float:
        """Return the objective [m]."""
        effort = float(found.weights @ found.weights)
        return found.worst + self.program.rho * effort + self.price * found.missed

    @property
    def price(self) -> float:
        """Of what is missed [m]."""
        return 0.0 if self.program.trust is None else self.program.trust.price

    def _put_cones(self, put: Callable[[Matrix, Vector, object], None]) -> None:
        """Add the amplitudes of all members' modes, and their sums to tips."""
        for i, response in enumerate(self.program.responses):
            slope, offset = response.path.end
            modes = len(response.rest.modes) // 2
            columns = self.first_mode[i] + np.arange(modes)
            amplitude = response.rest.modes @ slope * self.unit / self.scale
            constant = response.rest.modes @ offset / self.scale
            size = np.abs(response.rest.tip_of_modes).max(axis=0, initial=1e-300)
            for r, column in enumerate(columns):
                rows = np.zeros((3, self.size))
                rows[0, column] = -1.0
                rows[1:, : self.g] = -size[r] * amplitude[[r, modes + r]]
                at = np.concatenate(([0.0], size[r] * constant[[r, modes + r]]))
                put(rows, at, clarabel.SecondOrderConeT(3))
            sums = np.zeros((response.tips, self.size))
            sums[:, columns] = response.rest.tip_of_modes / size
            sums[:, self.g] = -1.0
            put(sums, np.zeros(response.tips), _nonnegative(response.tips))


def _nonnegative(size: int) -> object:
    return clarabel.NonnegativeConeT(size)
