"""Many testbeds at once are what each of them is alone."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flexslew_plant.own_code import ANY_CODE
from flexslew_plant.testbeds import (
    WITH_EQUATIONS,
    initial_state,
    initial_states,
    models_of,
    read_testbed,
)
from flexslew_plant.testbeds.compiled.traced_kernel import traced_kernel, traced_kernels
from flexslew_plant.testbeds.model import Model

OWN = f"{Path(__file__).parents[4] / 'docs/examples/three_joints.py'}:ThreeJoints"
CSA: tuple[dict[str, Any], ...] = (
    {"parameters": {"bending_stiffness": 900.0, "hub_radius": 0.7}, "damping_ratio": 0.01},
    {"parameters": {"length": 21.0, "linear_density": 0.3}, "initial": {"hub_pitch": 0.3}},
    {"parameters": {"length": 21.0, "hub_inertia_2": 500.0}, "initial": {"hub_pitch": -0.3}},
    {"variant": "printed", "parameters": {"hub_inertia_1": 1500.0, "base_inertia": 900.0}},
)


def beds(*sections: dict[str, Any]) -> list[Any]:
    return [read_testbed(section, "here", ANY_CODE) for section in sections]


def models(testbeds: list[Any]) -> list[Model]:
    found = models_of(testbeds)
    assert all(isinstance(model, Model) for model in found)
    return [model for model in found if isinstance(model, Model)]


def require_the_same(many: Model, alone: Model) -> None:
    assert many.packed.tobytes() == alone.packed.tobytes()
    assert (many.kernels, many.sizes, many.positions) == (
        alone.kernels,
        alone.sizes,
        alone.positions,
    )
    assert (many.joint_names, many.modes) == (alone.joint_names, alone.modes)
    assert (many.appendages.tip == alone.appendages.tip).all()


@pytest.mark.parametrize("kind", [*WITH_EQUATIONS, OWN], ids=lambda kind: kind.rpartition(":")[2])
def test_models_and_states_of_many_are_those_of_each(kind: str) -> None:
    testbeds = beds(*({"kind": kind} for _ in range(2)))
    for testbed, model in zip(testbeds, models(testbeds), strict=True):
        require_the_same(model, testbed.model())
    states = initial_states(testbeds, models(testbeds))
    assert states.tobytes() == np.array([initial_state(one) for one in testbeds]).tobytes()


@pytest.mark.parametrize("modes", [(3, 3, 3, 3), (2, 3, 1, 3)])
def test_numbers_of_many_csa_are_those_of_each(modes: tuple[int, ...]) -> None:
    testbeds = beds(*({**one, "modes": count} for one, count in zip(CSA, modes, strict=True)))
    for testbed, model in zip(testbeds, models(testbeds), strict=True):
        require_the_same(model, testbed.model())
        p = testbed.parameters
        moved = model.mass_matrix(model.rest({"hub_pitch": 0.0}))[1, 1] - p.hub_inertia_2
        end = p.length + p.hub_radius
        turning = 2.0 * p.linear_density * (end**3 - p.hub_radius**3) / 3.0  # of two rods
        assert moved == pytest.approx(turning, rel=1e-12)


def test_each_of_many_begins_where_its_joints_are() -> None:
    testbeds = beds(*CSA)
    states = initial_states(testbeds, models(testbeds))
    assert states[:, 1].tolist() == [0.0, 0.3, -0.3, 0.0]
    moving = beds(
        *({"kind": "floating_oscillator", "initial": {"free_mass_rate": v}} for v in (1.0, 2.0))
    )
    assert initial_states(moving, models(moving))[:, 3].tolist() == [1.0, 2.0]


def test_other_zeros_among_many_are_other_kernels() -> None:
    """Damping that is zero, and the other variant: their machine code leaves out what is zero."""
    found = models(beds(*CSA))
    kernels = traced_kernels(found, np.array([model.packed for model in found]), True)
    assert [k is traced_kernel(m, True) for k, m in zip(kernels, found, strict=True)] == [True] * 4
    assert kernels[1] is kernels[2]
    assert len({id(kernel) for kernel in kernels}) == 3
