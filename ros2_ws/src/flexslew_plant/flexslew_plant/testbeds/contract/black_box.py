"""Testbeds without equations: what is known of them is how they answer efforts."""

from collections import deque
from typing import Protocol, runtime_checkable

from flexslew_plant.arrays import Vector
from flexslew_plant.events import Fact


class RunningPlant(Protocol):
    """A black box that is running. All of its errors are a PlantFault of one line."""

    @property
    def facts(self) -> deque[Fact]:
        """What it has to note in the log; its reader empties it."""

    def reset(self) -> Vector:
        """Return to tick 0; return the state there (see BlackBox)."""

    def advance(self, effort: Vector) -> Vector:
        """Return the state a period later with the efforts held, shape (joints,) [N m or N]."""

    def stop(self) -> None:
        """Stop its motion until the next reset; a second call changes nothing."""

    def close(self) -> int | None:
        """End it, and return its exit status if it has one; a second call changes nothing."""


@runtime_checkable
class BlackBox(Protocol):
    """A testbed that only flies: a program, a file of machine code, or hardware.

    Its state is [joint positions, readings of the tips, joint velocities, rates of the tips], so
    the readings stand where other testbeds have modal coordinates, and its `model()` is
    black_box.black_box_model(...): names, units and sizes without equations.
    """

    @property
    def brake_damping(self) -> tuple[float, ...]:
        """Damping of the drive's brake per joint [N m s/rad or N s/m]; (): it exerts no effort."""

    @property
    def own_clock(self) -> bool:
        """Whether it paces the ticks by a clock of its own, as a rig does."""

    def start(self, period: float) -> RunningPlant:
        """Return the plant, running, before its first reset.

        Args:
            period: one tick [s].

        Raises:
            BadInput: it cannot be started, or is not what the section describes.
        """


def has_own_clock(testbed: object) -> bool:
    """Return whether a testbed is a rig that paces the ticks by a clock of its own."""
    return isinstance(testbed, BlackBox) and testbed.own_clock
