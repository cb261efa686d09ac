"""What a planner reports of an iteration."""

from collections.abc import Callable
from typing import NamedTuple, TypeAlias


class Update(NamedTuple):
    """What one update of the iteration came to."""

    number: int  # from 1 on
    objective: float  # J = ||Y||^2 + rho ||U||^2 (22)
    norm_terminal_error: float  # ||Y||
    norm_input: float  # ||U|| [N m]
    change: float  # ||U_k+1 - U_k|| / ||U_k+1||
    fresh: bool  # whether G was taken at U_k


Progress: TypeAlias = Callable[[Update], None]


def ignore(update: Update) -> None:
    """Do nothing with an update, where there is no listener."""
