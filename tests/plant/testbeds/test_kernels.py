"""The names by which the compiler finds the equations of a testbed again."""

from flexslew_plant.testbeds.kernels import Kernels, known
from flexslew_plant.testbeds.linear.motion import (
    ANYWHERE,
    IN_JOINTS,
    actuation,
    potential,
    residual_jacobian,
    terms,
)


def test_equations_of_one_file_that_differ_in_a_function_have_different_names() -> None:
    without_solution = Kernels(terms, residual_jacobian, potential, actuation)
    kernels = (IN_JOINTS, ANYWHERE, without_solution)
    assert len({one.token for one in kernels}) == len(kernels)
    assert [known(one.token) for one in kernels] == list(kernels)
