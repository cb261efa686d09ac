"""Time-optimal slews by all drives at once: multistart of a transcription, then the exact arcs.

The CSA testbed pitches to turn faster: folding the beams towards the yaw axis lowers its inertia.
Such slews have no closed form. From several random guesses, CasADi and IPOPT solve
    min T,    x_k+1 = RK4(x_k, u_k, T/N),    |u_k| <= amplitude,
and the signs of the best one are the structure; minimum_durations makes its arcs exact.
CasADi is an optional dependency.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from flexslew_control.planners.progress import Progress, Update
from flexslew_control.planners.time_optimal.arcs import ModelEnsemble, final_sensitivity
from flexslew_control.planners.time_optimal.interruptible import Interrupt, interruptible
from flexslew_control.planners.time_optimal.optimal_switching import (
    minimum_durations,
    nearest_durations,
)
from flexslew_control.planners.trajectories import rigid_duration
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput, PlanFailed
from flexslew_plant.extras import install_command
from flexslew_plant.testbeds import Testbed
from flexslew_plant.testbeds.contract import Symbolic
from flexslew_plant.testbeds.model import Model

_INTERVALS = 100
_STARTS = 4
_SEED = 1
_STEP = 0.25  # longest integration step, as an angle of the fastest mode [rad]


@dataclass(frozen=True)
class AllDrives:
    """A slew from rest to rest with every effort at +- its amplitude.

    Args:
        model: what is turned.
        start: state at rest, shape (2 n,).
        goal: state at rest, shape (2 n,).
        amplitude: of the efforts, shape (joints,) [N m].
        signs: of the efforts of each arc, or shares of the amplitude, shape (arcs, joints).
    """

    model: Model
    start: Vector
    goal: Vector
    amplitude: Vector
    signs: Matrix

    @property
    def has_partial_efforts(self) -> bool:
        """Whether some efforts are not at their amplitude: the arcs are a programme's intervals."""
        return bool((np.abs(self.signs) != 1.0).any())

    @property
    def step(self) -> float:
        """Longest integration step [s]."""
        linear = self.model.linearise(self.goal[: self.model.coordinates])
        return float(_STEP / linear.frequencies[-1])

    @property
    def conditions(self) -> Matrix:
        """C of the end conditions r = C z - goal."""
        return np.eye(self.start.size)

    @property
    def ensemble(self) -> ModelEnsemble:
        """What `arcs` simulates: the model alone."""
        zeros = np.zeros(self.model.joints)
        return ModelEnsemble(self.model.rates, self.model.packed[None], zeros, zeros)

    @property
    def rigid_duration(self) -> float:
        """Duration of the slowest joint's time-optimal slew on a rigid body [s]."""
        m = self.model.joints
        return rigid_duration(self.model, self.start[:m], self.goal[:m], self.amplitude)

    def efforts(self, arcs: int) -> Matrix:
        """Return the effort of each arc, shape (arcs, joints)."""
        return self.signs * self.amplitude

    def residual_jacobian(self, durations: Vector) -> tuple[Vector, Matrix]:
        """Return what misses the goal (2 n,) and its derivatives by the durations (2 n, arcs)."""
        efforts = self.efforts(durations.size)
        x, slopes = final_sensitivity(self.ensemble, self.start, efforts, durations, self.step)
        return x - self.goal, slopes


def time_optimal_slew(
    testbed: Testbed, start: Vector, goal: Vector, amplitude: Vector, progress: Progress
) -> tuple[AllDrives, Vector]:
    """Return the fastest slew found and the durations of its arcs.

    Args:
        testbed: with one mode or more, and energies in symbols (contract.Symbolic).
        start, goal: states at rest, shape (2 n,).
        amplitude: of the efforts, shape (joints,) [N m].
        progress: called after every start, with the least duration so far for its objective.

    Raises:
        BadInput: CasADi is missing, or the testbed gives no energies in symbols.
        PlanFailed: no start leads to a slew.
    """
    model = testbed.model()
    solve = _transcription(testbed, start, goal, amplitude)
    rng = np.random.default_rng(_SEED)
    found: list[tuple[float, Matrix]] = []
    for k in range(_STARTS):
        attempt = solve(rng)
        if attempt is not None:
            found.append(attempt)
        best = min((duration for duration, _ in found), default=np.inf)
        progress(Update(k + 1, best, np.nan, np.nan, np.nan, True))
    found.sort(key=lambda one: one[0])
    for duration, shares in found:
        signs, guess = structure_of(duration, shares)
        slew = AllDrives(model, start, goal, amplitude, signs)
        durations = minimum_durations(slew, guess)
        if durations is not None:
            return slew, durations
    for duration, shares in found:  # some effort does not matter: keep what the programme gave it
        slew = AllDrives(model, start, goal, amplitude, shares)
        durations = nearest_durations(slew, np.full(len(shares), duration / len(shares)))
        if durations is not None:
            return slew, durations
    raise PlanFailed(
        f"none of {_STARTS} starts led to a slew by all drives ({len(found)} converged); use other "
        "amplitudes or another goal"
    )


def structure_of(duration: float, shares: Matrix) -> tuple[Matrix, Vector]:
    """Return the signs of the arcs and their durations.

    Args:
        duration: T [s].
        shares: u/amplitude of the intervals, shape (N, joints): +-1 but where it switches.
    """
    step = duration / len(shares)
    switches = []
    for j, u in enumerate(shares.T):
        for k in np.flatnonzero(np.diff(np.sign(u))):
            # the switch that leaves the impulse of the two intervals as it is
            at = k + 1.0 + 0.5 * np.sign(u[k]) * (u[k] + u[k + 1])
            switches.append((step * float(at), j))
    switches.sort()
    signs = [np.sign(shares[0])]
    for _, j in switches:
        signs.append(signs[-1].copy())
        signs[-1][j] *= -1.0
    edges = np.array([0.0, *(at for at, _ in switches), duration])
    return np.array(signs), np.maximum(np.diff(edges), 1e-3 * step)


def _transcription(
    testbed: Testbed, start: Vector, goal: Vector, amplitude: Vector
) -> Callable[[np.random.Generator], tuple[float, Matrix] | None]:
    """Return what solves the transcribed slew from a random guess: T and u/amplitude."""
    try:
        import casadi as ca
    except ImportError:
        raise BadInput(
            f"plan: goal: slews by all drives need the package casadi: {install_command('casadi')}"
        ) from None
    if not isinstance(testbed, Symbolic):
        raise BadInput(
            "this testbed does not give its energies in symbols, which a slew by several drives "
            "needs; take another method",
            "plan",
            "method",
        )
    model = testbed.model()
    n, m = model.coordinates, model.joints
    rate = _rate(ca, testbed, n, m)
    x, u, h = ca.SX.sym("x", 2 * n), ca.SX.sym("u", m), ca.SX.sym("h")
    k1 = rate(x, u)
    k2 = rate(x + h / 2.0 * k1, u)
    k3 = rate(x + h / 2.0 * k2, u)
    k4 = rate(x + h * k3, u)
    step = ca.Function("step", [x, u, h], [x + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)])
    problem = ca.Opti()
    states = problem.variable(2 * n, _INTERVALS + 1)
    shares, duration = problem.variable(m, _INTERVALS), problem.variable()
    durations = ca.repmat(duration / _INTERVALS, 1, _INTERVALS)
    efforts = ca.diag(amplitude) @ shares
    problem.subject_to(states[:, 1:] == step.map(_INTERVALS)(states[:, :-1], efforts, durations))
    problem.subject_to(problem.bounded(-1.0, shares, 1.0))
    problem.subject_to(states[:, 0] == start)
    problem.subject_to(states[:, -1] == goal)
    problem.subject_to(duration >= 1e-3)
    problem.minimize(duration)
    quiet: dict[str, Any] = {"print_level": 0, "sb": "yes", "max_iter": 500, "tol": 1e-8}
    problem.solver("ipopt", {"print_time": False}, quiet)
    interrupt = Interrupt()
    problem.callback(interrupt.check)
    rigid = AllDrives(model, start, goal, amplitude, np.zeros((0, m))).rigid_duration

    def solve(rng: np.random.Generator) -> tuple[float, Matrix] | None:
        share = np.linspace(0.0, 1.0, _INTERVALS + 1)
        guess = np.outer(start, 1.0 - share) + np.outer(goal, share)
        guess[1:m] += rng.uniform(-1.2, 1.2, (m - 1, 1)) * np.sin(np.pi * share)
        problem.set_initial(states, guess)
        problem.set_initial(shares, rng.uniform(-0.5, 0.5, (m, _INTERVALS)))
        problem.set_initial(duration, 2.0 * rigid)
        with interruptible(interrupt):
            try:
                found = problem.solve()
            except RuntimeError:  # Opti raises it if IPOPT did not converge
                return None
        return float(found.value(duration)), np.asarray(found.value(shares)).T

    return solve


def _rate(ca: Any, testbed: Symbolic, n: int, joints: int) -> Any:
    """Return f(x, u) as a CasADi function, by Lagrange from the testbed's energies."""
    q, v, u = ca.SX.sym("q", n), ca.SX.sym("v", n), ca.SX.sym("u", joints)
    kinetic, potential, dissipation = testbed.energies(ca, q, v)
    mass, momentum = ca.hessian(kinetic, v)[0], ca.gradient(kinetic, v)
    force = ca.vertcat(u, ca.SX.zeros(n - joints)) - ca.gradient(dissipation, v)
    force += ca.gradient(kinetic - potential, q)
    acceleration = ca.solve(mass, force - ca.jtimes(momentum, q, v))
    return ca.Function("rate", [ca.vertcat(q, v), u], [ca.vertcat(v, acceleration)])
