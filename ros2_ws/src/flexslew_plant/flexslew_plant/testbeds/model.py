"""A testbed's equations of motion as one object: the mathematics that planners and laws share."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexslew_plant.arrays import Indices, Matrix, Tensor, Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.known_joints import require_joints
from flexslew_plant.notebook_table import in_notebook
from flexslew_plant.testbeds.appendages import Appendages as Appendages
from flexslew_plant.testbeds.compiled.bound import Bound, Rates, bound, joint_reader, rates_of
from flexslew_plant.testbeds.compiled.push import push_of
from flexslew_plant.testbeds.compiled.variations import (
    BlockSizes,
    Directions,
    flight_with_slopes,
    slopes_of_pieces,
)
from flexslew_plant.testbeds.kernels import NO_EQUATIONS, Kernels, require_equations
from flexslew_plant.testbeds.linearisation import Linearisation
from flexslew_plant.testbeds.orientation.attitude import AttitudeJoints
from flexslew_plant.testbeds.outside import Outside
from flexslew_plant.testbeds.tangent import tangent_jacobian


class Motors(NamedTuple):
    """Actuators that turn one coordinate against the platform, where friction acts, too."""

    names: tuple[str, ...]  # of their joints
    efforts: Indices  # which of the actuators, shape (k,)
    position: Indices  # where their coordinates stand in a state, shape (k,)
    rate: Indices  # where the rates of these, shape (k,)
    sign: Vector  # of the coordinate along the effort: -1 for a wheel, which reacts, shape (k,)


class ReactionWheels(NamedTuple):
    """Reaction wheels, each with a motor that drives it up to a speed."""

    efforts: Indices  # which of the actuators, shape (k,)
    rate: Indices  # where their speeds stand in a state, shape (k,)
    inertia: Vector  # about their axes, shape (k,) [kg m^2]
    fastest: Vector  # up to which they are driven, shape (k,) [rad/s]; infinite: no limit


NO_WHEELS = ReactionWheels(np.arange(0), np.arange(0), np.zeros(0), np.zeros(0))


class Coordinate(NamedTuple):
    """An entry of q or of v."""

    name: str
    unit: str  # empty: it has none


@dataclass(frozen=True, repr=False)
class Model:
    """M(q, t) a + h(q, v, t) = B u, with q the joints and then the modal coordinates.

    Args:
        kernels: the equations.
        packed: the numbers that they read.
        joint_names: names in the order of the coordinates.
        joint_units: rad or m, per joint.
        modes: number of modal coordinates.
        appendages: the readings of their sensors.
        actuators: number of efforts; None: one per joint.
        scale_stiffness: maps packed and a factor to packed with all stiffness times the factor,
            as `scaled` of the testbed; None: it cannot be scaled.
        time_varying: whether M, h or B depend on time.
        from_time: maps packed and a time to packed with its time zero then; None: there is none.
        leading: number of entries of v before the modes; None: the joints.
        known_as: the entries of q and of v before the modes, where they are not the joints.
        reading: maps a state to where each joint is and how fast; None: the first entries.
        rest_position: maps joint positions by name to q at rest; None: the first entries.
        motors: motors of the actuators; None: all, one in each joint, unless the kernels define
            what the efforts act on.
        spins: the wheels among them.
        attitude: the joints that read a platform's attitude; None: all errors are differences.
        outside: the forces that bench and members alone apply; None: there are none.
        one_way: the actuators that push in their positive direction alone.
        gimbals: the entries of v that are angles of gimbals, on which B depends.
        gyros: the actuators that turn them.
        highest_frequency: maps packed of many such testbeds, (P, k), to a bound of the frequencies
            of their modes with the joints free, (k,) [rad/s], found cheaply: members then take
            steps of a lower order; None: there is none.
    """

    kernels: Kernels
    packed: Vector
    joint_names: tuple[str, ...]
    joint_units: tuple[str, ...]
    modes: int
    appendages: Appendages
    actuators: int | None = None
    scale_stiffness: Callable[[Vector, float], Vector] | None = None
    time_varying: bool = False
    from_time: Callable[[Vector, float], Vector] | None = None
    leading: int | None = None
    known_as: tuple[tuple[Coordinate, ...], tuple[Coordinate, ...]] | None = None
    reading: Callable[[Vector], tuple[Vector, Vector]] | None = None
    rest_position: Callable[[Mapping[str, float]], Vector] | None = None
    motors: Motors | None = None
    spins: ReactionWheels = NO_WHEELS
    attitude: AttitudeJoints | None = None
    outside: Outside | None = None
    one_way: tuple[int, ...] = ()
    gimbals: tuple[int, ...] = ()
    gyros: tuple[int, ...] = ()
    highest_frequency: Callable[[Matrix], Vector] | None = None

    def __repr__(self) -> str:
        """Return one line: what it has of each."""
        parts = f"{self.joints} joints, {self.modes} modes, {len(self.appendages.names)} tips"
        return f"<Model of {parts}: {', '.join(self.joint_names)}>"

    def _repr_html_(self) -> str:
        """Return the joints and their units, for notebooks."""
        return in_notebook(repr(self), ("joint", "unit"), self.units_by_joint.items())

    @cached_property
    def joints(self) -> int:
        """How many joints."""
        return len(self.joint_names)

    @cached_property
    def units_by_joint(self) -> dict[str, str]:
        """The unit of each joint by its name, rad or m."""
        return dict(zip(self.joint_names, self.joint_units, strict=True))

    @cached_property
    def efforts(self) -> int:
        """How many actuators."""
        return self.joints if self.actuators is None else self.actuators

    @cached_property
    def coordinates(self) -> int:
        """n, joints and modes together: the entries of v."""
        return self.before_modes + self.modes

    @cached_property
    def before_modes(self) -> int:
        """How many entries of v stand before the modes."""
        return self.joints if self.leading is None else self.leading

    @cached_property
    def sizes(self) -> tuple[int, int, int, int, int]:
        """How many coordinates, how many before the modes, efforts, joints and modes."""
        return self.coordinates, self.before_modes, self.efforts, self.joints, self.modes

    @cached_property
    def positions(self) -> int:
        """How many entries q has: n, or one more for each unit quaternion."""
        return self.coordinates + self.kernels.extra_positions

    @property
    def has_efforts_in_joints(self) -> bool:
        """Whether an effort does work along what its joint reads alone, as a motor in it does."""
        return self.leading is not None or self.kernels.actuation is None

    @cached_property
    def resolved_motors(self) -> Motors:
        """The motors in joints and wheels; none of other actuators."""
        if self.motors is not None:
            return self.motors
        count = self.joints if self.kernels.actuation is None else 0
        each = np.arange(count)
        return Motors(self.joint_names[:count], each, each, self.positions + each, np.ones(count))

    @property
    def has_equations(self) -> bool:
        """Whether it has equations; a black box has none, and all that needs them is refused."""
        return self.kernels is not NO_EQUATIONS

    @cached_property
    def _bound(self) -> Bound:
        return bound(self.kernels, self.coordinates, self.before_modes)

    @cached_property
    def state_columns(self) -> tuple[tuple[Coordinate, ...], tuple[Coordinate, ...]]:
        """A name, fit for the column of a table, and a unit for each entry of q and of v."""
        joints = tuple(map(Coordinate, self.joint_names, self.joint_units))
        q, v = self.known_as or (joints, tuple(Coordinate(n, f"{u}/s") for n, u in joints))
        modes = [f"mode_{k + 1}" for k in range(self.modes)]
        return (
            (*q, *(Coordinate(name, "m") for name in modes)),
            (*v, *(Coordinate(name, "m/s") for name in modes)),
        )

    @cached_property
    def state_names(self) -> tuple[str, ...]:
        """A name for each entry of [q, v]."""
        q: tuple[str, ...] = self.joint_names
        v = q
        if self.leading is not None:
            q = tuple(f"position {k + 1}" for k in range(self.positions - self.modes))
            v = tuple(f"velocity {k + 1}" for k in range(self.before_modes))
        modes = tuple(f"mode {j + 1}" for j in range(self.modes))
        return (*q, *modes, *(f"{name} rate" for name in (*v, *modes)))

    def rest(self, positions: Mapping[str, float]) -> Vector:
        """Return q at rest, named joints at these positions, others zero, shape (positions,).

        Args:
            positions: joint name to position [rad or m].

        Raises:
            BadInput: a name is no joint of the model.
        """
        require_joints(positions, self.joint_names)
        if self.rest_position is not None:
            return self.rest_position(positions)
        rest = np.zeros(self.positions)
        rest[: self.joints] = [positions.get(name, 0.0) for name in self.joint_names]
        return rest

    def _require(self, x: Vector, effort: Vector | None = None) -> None:
        """Check what machine code reads without looking."""
        state, efforts = self._shapes
        if getattr(x, "shape", None) != state:
            names = ", ".join(self.state_names)
            raise ValueError(f"a state of shape {_shape(x)} does not fit: {state}, {names}")
        if effort is not None and getattr(effort, "shape", None) != efforts:
            words = f"({self.efforts},), one per actuator"
            raise ValueError(f"efforts of shape {_shape(effort)} do not fit: {words}")

    @cached_property
    def _shapes(self) -> tuple[tuple[int], tuple[int]]:
        """Those of a state and of efforts."""
        return (self.positions + self.coordinates,), (self.efforts,)

    def _join_state(self, q: Vector, v: Vector) -> Vector:
        """Return the state [q, v].

        Raises:
            ValueError: one of them has another shape.
        """
        for name, part, size in (("q", q, self.positions), ("v", v, self.coordinates)):
            if np.shape(part) != (size,):
                words = f"({size},), for a state of {', '.join(self.state_names)}"
                raise ValueError(f"{name} of shape {np.shape(part)} does not fit: {words}")
        return np.concatenate((q, v), dtype=np.float64)

    def input_matrix(self, q: Vector, t: float = 0.0, v: Vector | None = None) -> Matrix:
        """Return B(q, t), shape (n, actuators), with gimbals at zero or as they stand in v."""
        if self.kernels.actuation is None:
            return np.eye(self.coordinates, self.efforts)
        angles = np.zeros(self.coordinates)
        if v is not None:
            angles[list(self.gimbals)] = v[list(self.gimbals)]
        x, columns = self._join_state(q, angles), []
        for one in np.eye(self.efforts):
            column = np.zeros(self.coordinates)
            self._bound.actuation(self.packed, t, x, one, column)
            columns.append(column)
        return np.array(columns).T

    def generalised_forces(self, x: Vector, effort: Vector, t: float = 0.0) -> Vector:
        """Return B(q, t) u, shape (n,)."""
        self._require(x, effort)
        out = np.zeros(self.coordinates)
        if self.kernels.actuation is None:
            out[: self.efforts] = effort
        else:
            self._bound.actuation(self.packed, t, x, effort, out)
        return out

    def _terms(self, q: Vector, v: Vector, t: float) -> tuple[Matrix, Vector]:
        n = self.coordinates
        s = n if self.kernels.full_mass else self.before_modes
        joints, coupling, modal = np.empty((s, s)), np.empty((s, n - s)), np.empty(n - s)
        bias = np.empty(n)
        x = self._join_state(q, v)
        self._bound.terms(self.packed, t, x, joints, coupling, modal, bias)
        mass = np.zeros((n, n))
        mass[:s, :s], mass[:s, s:], mass[s:, :s] = joints, coupling, coupling.T
        mass.flat[s * (n + 1) :: n + 1] = modal
        return mass, bias

    def mass_matrix(self, q: Vector, t: float = 0.0) -> Matrix:
        """Return M(q, t), shape (n, n), symmetric positive definite."""
        return self._terms(q, np.zeros(self.coordinates), t)[0]

    def bias(self, q: Vector, v: Vector, t: float = 0.0) -> Vector:
        """Return h(q, v, t): centrifugal, Coriolis, elastic and damping terms, shape (n,)."""
        return self._terms(q, v, t)[1]

    def derivative(self, x: Vector, effort: Vector, t: float = 0.0) -> Vector:
        """Return f(t, x, u), shape of x, for the state x = [q, v].

        Raises:
            ValueError: x or the effort has another shape; so do all that take them.
        """
        self._require(x, effort)
        return self._bound.derivative(self.packed, t, x, effort)

    def advance(
        self, x: Vector, effort: Vector, dt: float, steps: int = 1, t: float = 0.0
    ) -> Vector:
        """Return the state dt after t with the effort held (order 8, `steps` equal steps)."""
        self._require(x, effort)
        return self.advance_checked(x, effort, dt, steps, t)

    def advance_checked(self, x: Vector, effort: Vector, dt: float, steps: int, t: float) -> Vector:
        """Return what `advance` does, of a state and efforts whose shapes are known to fit."""
        after = np.array(x, np.float64)
        self.integrate(self.packed, t, effort, dt, steps, self.before_modes, after)
        return after

    def path(self, x: Vector, efforts: Matrix, dt: float, steps: int = 1, t: float = 0.0) -> Matrix:
        """Return where each of the efforts leads, held for dt one after the other; see advance.

        Args:
            x: the state at t.
            efforts: shape (N, actuators).
            dt: of each [s].
            steps: of each, equal.
            t: at the start [s].

        Returns:
            The states at t + dt ... t + N dt, a row each.
        """
        self._require(x, efforts[0])
        now, found = np.array(x, dtype=np.float64), np.empty((len(efforts), x.size))
        for k, effort in enumerate(efforts):
            self.integrate(self.packed, t + k * dt, effort, dt, steps, self.before_modes, now)
            found[k] = now
        return found

    def apply_impulse(self, x: Vector, dt: float, t: float) -> Vector:
        """Return the state at t after the impulse of `outside` from t to t + dt.

        With a negative dt it is the impulse between t + dt and t.
        """
        if self.outside is None:
            return x
        self._require(x)
        after, push = np.array(x, dtype=np.float64), push_of(self.kernels, self.outside.add)
        push(self.packed, self.outside.numbers, t, dt, self.before_modes, after)
        return after

    @cached_property
    def integrate(self) -> Callable[[Vector, float, Vector, float, int, int, Vector], None]:
        """The kernel of `advance`, for compiled loops: see bound.ADVANCE."""
        return self._bound.advance

    @cached_property
    def rates(self) -> Rates:
        """The kernels of `derivative` and `jacobian`, for compiled loops; where q' = v."""
        require_equations(self.kernels)
        return rates_of(self.kernels, self.before_modes)

    def jacobian(self, x: Vector, effort: Vector, t: float = 0.0) -> tuple[Matrix, Matrix]:
        """Return df/dx, shape (2 n, 2 n), and df/du, shape (2 n, actuators), exact.

        Where q' is not v it is that of the tangent space: of small motions e along v, so that q
        becomes q + N(q) e (a platform's place and attitude along body axes), and of v.
        """
        self._require(x, effort)
        if self.kernels.extra_positions:
            return tangent_jacobian(self, x, effort, t)
        dx, du = np.empty((x.size, x.size)), np.empty((x.size, self.efforts))
        self._bound.jacobian(self.packed, t, x, effort, dx, du)
        return dx, du

    def flight_with_slopes(
        self, start: Vector, start_slopes: Matrix, along: Matrix, effort: Matrix, period: float
    ) -> tuple[Matrix, Matrix]:
        """Return a flight and its exact derivatives by numbers of the equations.

        Args:
            start: state [q, v].
            start_slopes: its derivatives, shape (parameters, size of a state).
            along: derivatives of `packed`, shape (parameters, its size).
            effort: held over every tick, shape (ticks, actuators) [N m or N].
            period: one tick [s].

        Returns:
            The states at the ticks, shape (ticks + 1, size of a state), and their derivatives,
            shape (ticks + 1, parameters, size of a state).
        """
        none = np.zeros((len(along), effort.shape[1]))
        given = Directions(self.packed, along, none), start, start_slopes, effort, period
        return flight_with_slopes(self._bound, *given, self._sizes)

    def slopes_of_pieces(
        self,
        states: Matrix,
        effort: Matrix,
        durations: Vector,
        steps: Indices,
        columns: Indices | None = None,
    ) -> tuple[Tensor, Tensor]:
        """Return the exact derivatives of what `advance` finds, piece by piece of a flight.

        Args:
            states: at the begins of the pieces, shape (k, size of a state).
            effort: held over every piece, shape (k, actuators) [N m or N].
            durations: of the pieces, the first from time zero on, shape (k,) [s].
            steps: equal ones, of every piece, shape (k,).
            columns: entries of a state by which they are taken; None: all.

        Returns:
            of the ends by the begins, (k, size, size), and by the efforts, (k, size, actuators).
        """
        which = np.arange(states.shape[1]) if columns is None else columns
        if self.kernels.advance is not None:
            return self._exact_slopes(durations, which)
        given = states, effort, durations, steps, which, self._sizes
        return slopes_of_pieces(self._bound, self.packed, *given)

    def _exact_slopes(self, durations: Vector, columns: Indices) -> tuple[Tensor, Tensor]:
        """Return slopes_of_pieces of equations with an exact solution, which is linear."""
        pieces, which = np.unique(durations, return_inverse=True)
        maps = [self.held_maps(float(duration)) for duration in pieces]
        by_state = np.array([maps[k][0][:, columns] for k in which])
        return by_state, np.array([maps[k][1] for k in which])

    def held_maps(self, dt: float) -> tuple[Matrix, Matrix]:
        """Return F, (2 n, 2 n), and G, (2 n, actuators), of x(dt) = F x + G u with u held.

        Of equations with an exact solution, which is linear: see Kernels.advance.
        """
        size = self.positions + self.coordinates
        still, rest = np.zeros(self.efforts), np.zeros(size)
        by_state = [self.advance(one, still, dt) for one in np.eye(size)]
        by_effort = [self.advance(rest, one, dt) for one in np.eye(self.efforts)]
        return np.array(by_state).T, np.array(by_effort).T

    def integrated_poles(self, q: Vector) -> NDArray[np.complex128]:
        """Return the poles at rest that integration steps follow [1/s]; none of what is exact."""
        if self.kernels.advance is not None or not self.has_equations:
            return np.zeros(0, dtype=np.complex128)
        return self.linearise(q).eigenvalues

    @property
    def _sizes(self) -> BlockSizes:
        """Of the equations."""
        square = self.coordinates if self.kernels.full_mass else self.before_modes
        return BlockSizes(square, self.kernels.extra_positions)

    def residual_slopes(
        self, x: Vector, acceleration: Vector, t: float = 0.0
    ) -> tuple[Matrix, Matrix]:
        """Return the derivatives of M a + h by q and by v at a fixed a, (n, positions), (n, n)."""
        self._require(x)
        if getattr(acceleration, "shape", None) != (self.coordinates,):
            words = f"({self.coordinates},), one per coordinate"
            raise ValueError(f"accelerations of shape {_shape(acceleration)} do not fit: {words}")
        dq = np.empty((self.coordinates, self.positions))
        dv = np.empty((self.coordinates, self.coordinates))
        self._bound.residual_jacobian(self.packed, t, x, acceleration, dq, dv)
        return dq, dv

    def with_stiffness(self, factor: float) -> "Model":
        """Return the model with every stiffness times factor [-], as `scaled` of its testbed.

        Raises:
            BadInput: if its testbed does not define how.
        """
        if self.scale_stiffness is None:
            raise BadInput("the stiffness of this testbed cannot be scaled")
        return self.with_packed(self.scale_stiffness(self.packed, factor))

    def with_time_zero(self, time: float) -> "Model":
        """Return the model with its time zero at a time of this one [s]."""
        if not self.time_varying or self.from_time is None or time == 0.0:
            return self
        return self.with_packed(self.from_time(self.packed, time))

    def with_packed(self, packed: Vector) -> "Model":
        """Return the model with other numbers, of which nothing else of it is made.

        It is there at once, for thousands a second: what this one has found out about itself, all
        of it from sizes and names, holds for the other one.
        """
        _ = self.sizes, self.positions  # known from here on
        other = object.__new__(Model)
        vars(other).update(vars(self), packed=packed)
        return other

    def position_rates(self, q: Vector, t: float = 0.0) -> Matrix:
        """Return N of q' = N(q) v, shape (positions, n)."""
        x, columns = self._join_state(q, np.zeros(self.coordinates)), []
        for one in np.eye(self.coordinates):
            x[self.positions :], rate = one, np.empty(self.positions)
            self._bound.position_rates(self.packed, t, x, rate)
            columns.append(rate)
        return np.array(columns).T

    def split(self, x: Vector) -> tuple[Vector, Vector]:
        """Return q and v of a state."""
        return x[: self.positions], x[self.positions :]

    def joint_state(self, x: Vector) -> tuple[Vector, Vector]:
        """Return position and velocity of each joint, each of shape (joints,)."""
        if self.reading is not None:
            return self.reading(x)
        position, rate = self._of_joints
        return x[position], x[rate]

    def joint_states(self, states: Matrix) -> tuple[Matrix, Matrix]:
        """Return positions and velocities of the joints in many states, each (k, joints)."""
        if self.reading is None:
            position, rate = self._of_joints
            return states[:, position], states[:, rate]
        result = np.empty((2, len(states), self.joints))
        if self.kernels.reading is not None:
            joint_reader(self.kernels)(self.packed, states, result[0], result[1])
        else:
            for k, x in enumerate(states):
                result[:, k] = self.reading(x)
        return result[0], result[1]

    def joint_error(self, position: Vector, goal: Vector) -> Vector:
        """Return goal - position of each joint, of an attitude the rotation [rad or m].

        Args:
            position: of the joints, shape (..., joints).
            goal: where they go, shape (joints,) or (..., joints).
        """
        if self.attitude is None:
            return goal - position
        return self.attitude.error(position, goal)

    def modal_state(self, x: Vector) -> tuple[Vector, Vector]:
        """Return the modal coordinates and their rates, each of shape (..., modes)."""
        modal, rate = self._of_modes
        return x[..., modal], x[..., rate]

    def deflections(self, x: Vector) -> tuple[Vector, Vector]:
        """Return tip deflections [m] and root curvatures [1/m], each of shape (appendages,)."""
        both = self._of_appendages.dot(x[self._of_modes[0]])
        count = len(self.appendages.tip)
        return both[:count], both[count:]

    @cached_property
    def _of_appendages(self) -> Matrix:
        """Tips and then curvatures of the modal coordinates: one product is quicker than two."""
        return np.vstack((self.appendages.tip, self.appendages.curvature))

    @cached_property
    def _of_joints(self) -> tuple[slice, slice]:
        """Where positions and rates of the joints stand in a state."""
        return slice(self.joints), slice(self.positions, self.positions + self.joints)

    @cached_property
    def _of_modes(self) -> tuple[slice, slice]:
        """Where modal coordinates and their rates stand in a state."""
        first = self.positions - self.modes
        return slice(first, self.positions), slice(self.positions + self.before_modes, None)

    def mobility(self, x: Vector, effort: Vector, t: float = 0.0) -> Matrix:
        """Return d(joint acceleration)/d(effort), (joints, actuators) [1/(kg m^2) or 1/kg]."""
        if self.leading is None:
            n = self.coordinates
            return self.jacobian(x, effort, t)[1][n : n + self.joints]
        q, _ = self.split(x)
        b = self.input_matrix(q, t)
        response: Matrix = b.T @ np.linalg.solve(self.mass_matrix(q, t), b)
        return response

    def inertias(self, x: Vector) -> Vector:
        """Return what each effort moves alone, shape (joints,) [kg m^2 or kg]: effort over the
        acceleration of what its joint reads, infinite where it does not speed its joint up.

        A wheel's joint reads the platform's turn, a thruster's that turn times its lever.
        """
        q, _ = self.split(x)
        if self.leading is None:
            return np.diag(self.mass_matrix(q))[: self.joints]
        response = np.linalg.solve(self.mass_matrix(q), self.input_matrix(q)).T
        joint_acceleration = [
            self.joint_state(self._join_state(q, v))[1][k] for k, v in enumerate(response)
        ]
        positive_part = np.maximum(joint_acceleration, 0.0)
        return np.divide(
            1.0, positive_part, out=np.full(positive_part.shape, np.inf), where=positive_part > 0.0
        )

    def energy(self, x: Vector, t: float = 0.0) -> float:
        """Return T + U [J], constant without effort, damping and dependence on time.

        What rotors of gyros have is left out: their motors keep it. That of a black box is not
        known: 0.
        """
        self._require(x)
        if not self.has_equations:
            return 0.0
        if self.gimbals:  # they have a momentum and no inertia
            x = x.copy()
            x[self.positions + np.array(self.gimbals)] = 0.0
        return self._bound.energy(self.packed, t, x)

    def kinetic_energy(self, x: Vector, t: float = 0.0) -> float:
        """Return T = v^T M(q) v / 2 [J]."""
        q, v = self.split(x)
        return float(0.5 * v @ self.mass_matrix(q, t) @ v)

    def momentum(self, x: Vector, t: float = 0.0) -> Vector:
        """Return dT/dv = M(q) v, shape (n,); csa conserves the first without yaw torque."""
        q, v = self.split(x)
        return self.mass_matrix(q, t) @ v

    def linearise(self, q: Vector, t: float = 0.0) -> Linearisation:
        """Return the small motions about the rest at q (14), (15).

        Args:
            q: at rest, beams straight, shape (positions,).
            t: time at which the model is frozen [s].
        """
        zero_rates = np.zeros(self.coordinates)
        stiffness, damping = self.residual_slopes(self._join_state(q, zero_rates), zero_rates, t)
        if self.kernels.extra_positions:  # by motions along v
            stiffness = stiffness @ self.position_rates(q, t)
        reading = None if self.has_efforts_in_joints else np.eye(self.joints, self.coordinates)
        mass, b = self.mass_matrix(q, t), self.input_matrix(q, t)
        return Linearisation(mass, damping, stiffness, b, reading=reading)


def _shape(given: object) -> str:
    """Return the shape of an array for an error; of what is none, its type."""
    return str(given.shape) if isinstance(given, np.ndarray) else f"a {type(given).__name__}"
