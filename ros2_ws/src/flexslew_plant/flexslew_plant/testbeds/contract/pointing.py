"""Testbeds with a platform, appendages and antennas that point somewhere."""

from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from flexslew_plant.arrays import Matrix, Vector


class Motions(NamedTuple):
    """Motions at k times, in body axes.

    Args:
        attitude: turn from the goal's attitude, shape (k, 3) [rad].
        turned: turn from the inertial attitude, shape (k, 3) [rad].
        place: of the body origin in inertial space, shape (k, 3) [m].
        away: the same from where it is at the goal, shape (k, 3) [m].
        tips: elastic displacement of each tip, by appendage, shape (k, 3) [m].
        turns: elastic turn of each tip, by appendage, shape (k, 3) [rad].
        wheels: momentum of each wheel's spin relative to the platform, by name, (k,) [N m s].
    """

    attitude: Matrix
    turned: Matrix
    place: Matrix
    away: Matrix
    tips: dict[str, Matrix]
    turns: dict[str, Matrix]
    wheels: dict[str, Vector]


class Spins(NamedTuple):
    """What wheels store at k times, relative to the platform.

    Args:
        speeds: of each wheel, by name, shape (k,) [rad/s].
        stored: momentum of all, gyros included, in body axes, shape (k, 3) [N m s].
        gimbals: angles of the gyros, by name, shape (k,) [rad].
        authority: smallest torque about any axis that equal gimbal rates give, over the largest
            about any, shape (k,); zero is a singularity [-].
    """

    speeds: dict[str, Vector]
    stored: Matrix
    gimbals: dict[str, Vector]
    authority: Vector


@runtime_checkable
class Pointing(Protocol):
    """A testbed with a platform and appendages that point somewhere."""

    @property
    def pointing_tolerance(self) -> float:
        """Error of an appendage's direction that is good enough [rad]."""

    @property
    def pointing_window(self) -> float:
        """Window of the mean and relative performance errors [s]."""

    @property
    def pointing_from(self) -> float:
        """From when on they count, if that is after the manoeuvre [s]."""

    def motions(self, position: Matrix, velocity: Matrix, goal: dict[str, float]) -> Motions:
        """Return the motions of logged states.

        Args:
            position: q, shape (k, positions).
            velocity: v, shape (k, n).
            goal: where the joints go, by name; empty: nowhere.
        """

    def spins(self, velocity: Matrix) -> Spins:
        """Return what its wheels store at logged rates v, shape (k, n)."""


class LineOfSight(NamedTuple):
    """The line of sight of an antenna, its z with its tip's turn, at k times."""

    hinge: Vector  # angle from the hinge's rest, (k,) [rad]
    error: Vector  # between the line of sight and its target in inertial space, (k,) [rad]
    rests: NDArray[np.bool_]  # a turn has ended, and no other one has started, (k,)


@runtime_checkable
class HasLinesOfSight(Protocol):
    """A testbed with antennas that turn to targets."""

    @property
    def pointing_tolerance(self) -> float:
        """Error of a line of sight that is good enough [rad]."""

    def lines_of_sight(
        self, time: Vector, position: Matrix, goal: dict[str, float]
    ) -> dict[str, LineOfSight]:
        """Return the lines of sight of all antennas that turn, by name.

        Args:
            time: shape (k,) [s].
            position: q, shape (k, positions).
            goal: where the joints go, by name; targets count from the platform's attitude there.
        """


class HingeTurn(NamedTuple):
    """A prescribed turn of an appendage."""

    appendage: str
    begin: float  # [s]
    end: float  # [s]
    to: float  # angle from the hinge's rest [rad]


@runtime_checkable
class Retargetable(Protocol):
    """A testbed with appendages that turn in a prescribed way."""

    def hinge_turns(self) -> tuple[HingeTurn, ...]:
        """Return all turns, in the order of their begin."""

    def retargeted(self, requested: dict[str, Any], at: float) -> dict[str, Any]:
        """Return the keys of the section that give an appendage a new target (see varied).

        Args:
            requested: `appendage`, and the keys of a motion of its hinge but for `at`.
            at: when it begins to turn [s].

        Raises:
            BadInput: no such appendage, or its hinge does not turn in a prescribed way.
        """
