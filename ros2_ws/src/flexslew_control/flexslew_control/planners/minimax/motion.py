"""How the members of a slew move, as the search of a plant that is not linear sees them."""

from typing import Protocol

from flexslew_control.analysis.lti import Lti
from flexslew_control.planners.minimax.response import RestMotion
from flexslew_control.planners.residual.closed_loop import ClosedLoopResponse
from flexslew_plant.arrays import Indices, Matrix, Tensor, Vector
from flexslew_plant.testbeds import Model


class MemberMotion(Protocol):
    """How members move from the start to the goal.

    A deviation from the rest at the goal has k coordinates and their rates, see RestMotion.
    """

    @property
    def columns(self) -> Indices | None:
        """The entries of a state by which derivatives are taken; None: all."""

    def at_rest(self, model: Model) -> RestMotion:
        """Return the small motions about the rest at the goal."""

    def flight(
        self, model: Model, efforts: Matrix, gains: Matrix, path: Matrix | None, motors: Lti
    ) -> ClosedLoopResponse:
        """Return the flight of a member.

        Args:
            model: equations of motion.
            efforts: of the plan, shape (ticks, joints).
            gains: [Kp Kd], shape (joints, 2 joints).
            path: of the nominal member, (ticks + 1, size); None: this is the nominal member.
            motors: from commands to efforts, tick by tick.
        """

    def feedback_derivatives(
        self, gains: Matrix, states: Matrix, path: Matrix
    ) -> tuple[Tensor, Tensor]:
        """Return those of the feedback at every tick, (ticks, joints, size) each.

        Args:
            gains: [Kp Kd], shape (joints, 2 joints).
            states: of the member, (ticks, size).
            path: of the nominal member, (ticks, size).

        Returns:
            by the member's own state, and by the nominal member's.
        """

    def outputs(self, model: Model) -> Matrix:
        """Return what reads tips, positions and rates off a state, (tips + 2 joints, size)."""

    def along(self, states: Matrix) -> Matrix:
        """Return what else has limits all along the path, shape (k, readings).

        Args:
            states: of a member, shape (k, size).
        """

    def along_slopes(self, states: Matrix) -> Tensor:
        """Return its derivatives by the states, shape (k, readings, size)."""

    def deviation(self, model: Model, x: Vector) -> Vector:
        """Return how far a state is from the rest at the goal, shape (2 k,)."""

    def deviation_slopes(self, model: Model, x: Vector) -> Matrix:
        """Return the derivatives of the deviation by the state, shape (2 k, size)."""
