"""A small plant in C, written by hand: a cart on a spring, advanced exactly over a tick."""

import numpy as np
from scipy.linalg import expm

from flexslew_lab.export.c_module import CModule, Signal
from flexslew_plant.arrays import Matrix

MASS, STIFFNESS, DAMPING, PERIOD = 2.0, 8.0, 0.4, 0.01  # [kg, N/m, N s/m, s]
_HEADER = """\
typedef struct { double state[2]; } cart_memory;
typedef struct { double time; double force; } cart_effort;
typedef struct { double position; double velocity; double pull[2]; } cart_measurement;
void cart_init(cart_memory *memory);
void cart_step(cart_memory *memory, const cart_effort *effort, cart_measurement *measurement);
"""
_SOURCE = """\
#include "cart.h"
void cart_init(cart_memory *memory) {{
    memory->state[0] = 0.25;
    memory->state[1] = 0.0;
}}
void cart_step(cart_memory *memory, const cart_effort *effort, cart_measurement *measurement) {{
    const double x = memory->state[0], v = memory->state[1], u = effort->force;
    memory->state[0] = {0} * x + {1} * v + {2} * u;
    memory->state[1] = {3} * x + {4} * v + {5} * u;
    measurement->position = memory->state[0];
    measurement->velocity = memory->state[1];
    measurement->pull[0] = u;
    measurement->pull[1] = effort->time;
}}
"""


def exact_step() -> Matrix:
    """Return [A, B] of a tick, shape (2, 3): the exponential of the equations of motion."""
    block = np.zeros((3, 3))
    block[0, 1] = 1.0
    block[1] = -STIFFNESS / MASS, -DAMPING / MASS, 1.0 / MASS
    step: Matrix = expm(block * PERIOD)[:2]
    return step


def cart_module() -> CModule:
    """Return the cart: it starts at 0.25 m, at rest."""
    source = _SOURCE.format(*(repr(float(x)) for x in exact_step().ravel()))
    return CModule(
        "cart",
        {"cart.c": source, "cart.h": _HEADER},
        (Signal("time", "s", 1, (0.0,)), Signal("force", "N", 1, (0.0,))),
        (
            Signal("position", "m", 1, (0.25,)),
            Signal("velocity", "m/s", 1, (0.0,)),
            Signal("pull", "", 2, (0.0, 0.0)),
        ),
        (),
        PERIOD,
        ("effort", "measurement"),
    )
