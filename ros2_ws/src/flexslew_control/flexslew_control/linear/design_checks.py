"""The requirements of a linear design on a model; an error names the one that does not hold."""

from collections.abc import Mapping
from typing import Annotated, Protocol

import numpy as np
from pydantic import AliasChoices, Field
from scipy.linalg import eig

from flexslew_control.law import PlantDescription
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.known_joints import ByJoint
from flexslew_plant.testbeds.linearisation import Linearisation
from flexslew_plant.testbeds.model import Appendages

_RANK_TOLERANCE = 1e-9  # of the pair in its own units
_RIGID = 1e-6  # of its norm: an eigenvalue below is a rigid motion's, zero
_ROUNDING = 1e-14  # of what the state or the effort moves most: rounding, such as cos(pi / 2)


class LinearDesignModel(Protocol):
    """What a linear design and its filter ask of a model; see testbeds.model.Model."""

    @property
    def joint_names(self) -> tuple[str, ...]:
        """In the order of the first coordinates."""

    @property
    def joints(self) -> int:
        """How many joints."""

    @property
    def coordinates(self) -> int:
        """n, joints and modes together."""

    @property
    def modes(self) -> int:
        """How many coordinates stand after the joints."""

    @property
    def appendages(self) -> Appendages:
        """What the sensors of the appendages read."""

    @property
    def time_varying(self) -> bool:
        """Whether it depends on time."""

    def rest(self, positions: Mapping[str, float]) -> Vector:
        """Return q at rest with joints at these positions."""

    def linearise(self, q: Vector, t: float = 0.0) -> Linearisation:
        """Return the small motions about the rest at q."""

    def jacobian(self, x: Vector, effort: Vector, t: float = 0.0) -> tuple[Matrix, Matrix]:
        """Return df/dx and df/du."""

    def advance(
        self, x: Vector, effort: Vector, dt: float, steps: int = 1, t: float = 0.0
    ) -> Vector:
        """Return the state dt after t with the effort held."""

    def path(self, x: Vector, efforts: Matrix, dt: float, steps: int = 1, t: float = 0.0) -> Matrix:
        """Return the states after each of the efforts, held for dt each."""


OperatingPoint = Annotated[
    ByJoint[float] | None,
    Field(
        validation_alias=AliasChoices("operating_point", "set_point"),  # as in logs of before
        description="joint positions at which the law is designed, by name [rad or m]; null: "
        "those of the testbed",
    ),
]


def operating_point_of(
    plant: PlantDescription,
    model: LinearDesignModel,
    given: dict[str, float] | None,
    share: float = 1.0,
) -> Vector:
    """Return the rest q about which a law is designed, shape (n,).

    Args:
        plant: what the law is designed for.
        model: what the law believes.
        given: the law's `operating_point`, joint to position [rad or m]; None: the testbed's.
        share: of the testbed's own operating point [-].

    Raises:
        BadInput: a name is no joint of the model.
    """
    default = {name: share * at for name, at in plant.testbed.operating_point.items()}
    try:
        return model.rest(default if given is None else given)
    except BadInput as error:
        raise BadInput(f"operating_point: {error}") from None


def state_names(model: LinearDesignModel) -> tuple[str, ...]:
    """Return a name for each entry of [q, v]."""
    q = (*model.joint_names, *(f"mode {j + 1}" for j in range(model.modes)))
    return (*q, *(f"{name} rate" for name in q))


def output_matrix(model: LinearDesignModel, with_tip: bool) -> Matrix:
    """Return C of y = C x: joint positions, joint rates and, if measured, the first tip.

    Shape (2 joints, 2 n), or one row more.

    Raises:
        BadInput: a tip shall be measured, and there is none.
    """
    if with_tip and not len(model.appendages.tip):
        raise BadInput("the testbed has no tip to measure; leave the noise of the tip out")
    n, m = model.coordinates, model.joints
    c = np.zeros((2 * m + with_tip, 2 * n))
    c[:m, :m] = np.eye(m)
    c[m : 2 * m, n : n + m] = np.eye(m)
    if with_tip:
        c[2 * m, m:n] = model.appendages.tip[0]
    return c


def require_controllable(a: Matrix, b: Matrix, names: tuple[str, ...]) -> None:
    """Check that the efforts move every mode of x' = A x + B u (Popov, Belevitch, Hautus).

    Args:
        a: shape (k, k).
        b: shape (k, m).
        names: of the states, for the message.

    Raises:
        BadInput: names the eigenvalue and the state that moves most in its mode.
    """
    hint = "move it to another operating point or add an actuator"
    _require(_clean(a), _clean(b), names, "not controllable", hint)


def require_observable(a: Matrix, c: Matrix, names: tuple[str, ...]) -> None:
    """Check that the outputs y = C x show every mode of x' = A x; see require_controllable."""
    hint = "move it to another operating point or add a sensor"
    _require(_clean(a).T, _clean(c.T), names, "not observable", hint)


def require_stable(a: Matrix, names: tuple[str, ...], what: str) -> None:
    """Check that every eigenvalue of A has a negative real part.

    Raises:
        BadInput: names the worst eigenvalue and the state that moves most in its mode.
    """
    values, vectors = eig(a)
    largest = int(np.argmax(values.real))
    if values[largest].real >= -1e-12 * float(abs(values).max()):
        state = names[int(np.argmax(abs(vectors[:, largest])))]
        raise BadInput(
            f"{what} is not stable: eigenvalue {_number(values[largest])} 1/s, mostly in {state}; "
            "give other gains"
        )


def _require(a: Matrix, b: Matrix, names: tuple[str, ...], fault: str, hint: str) -> None:
    """Refuse if [lambda I - A, B] loses rank at an eigenvalue lambda of A."""
    balanced, inputs, rate = _balanced_units(a, b)
    size = max(1.0, float(np.linalg.norm(balanced, 2)))
    for value in np.linalg.eigvals(balanced):
        # rigid motions are double and come out of the solver as plus and minus 1e-8
        at = 0.0 if abs(value) < _RIGID * size else value
        pencil = np.hstack((at * np.eye(len(a)) - balanced, inputs))
        left, singular, _ = np.linalg.svd(pencil)
        if singular[-1] < _RANK_TOLERANCE * size:
            state = names[int(np.argmax(abs(left[:, -1])))]
            raise BadInput(
                f"the model is {fault}: eigenvalue {_number(rate * at)} 1/s, mostly in {state}; "
                f"{hint}"
            )


def _clean(matrix: Matrix) -> Matrix:
    """Return the matrix without entries that are rounding compared with others of their column."""
    return np.where(abs(matrix) < _ROUNDING * abs(matrix).max(axis=0), 0.0, matrix)


def _balanced_units(a: Matrix, b: Matrix) -> tuple[Matrix, Matrix, float]:
    """Return A and B with states, inputs and time in units in which their entries are nearest one.

    Least squares of the logarithms of the nonzero entries: the same for all units of a and b.

    Args:
        a: shape (k, k).
        b: shape (k, m).

    Returns:
        A, B and what a rate of one is [1/s].
    """
    k, m = b.shape
    pair = np.hstack((a, b))
    rows, columns = np.nonzero(pair)
    entries = np.arange(len(rows))
    terms = np.zeros((len(rows), k + m + 1))  # of the units of states and inputs, and of time
    np.add.at(terms, (entries, columns), 1.0)
    np.add.at(terms, (entries, rows), -1.0)
    terms[columns < k, -1] = 1.0
    logarithms = -np.log(abs(pair[rows, columns]))
    *units, time = np.exp(np.linalg.lstsq(terms, logarithms, rcond=None)[0])
    scaled = pair * units / np.array(units)[:k, None]
    return time * scaled[:, :k], scaled[:, k:], float(1.0 / time)


def _number(value: complex) -> str:
    """Return an eigenvalue in six digits."""
    if abs(value.imag) < 1e-12:
        return f"{value.real:.6g}"
    real = value.real if abs(value.real) > 1e-12 * abs(value) else 0.0
    return f"{real:.6g}{value.imag:+.6g}j"
