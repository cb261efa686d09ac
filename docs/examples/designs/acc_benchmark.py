"""H-infinity laws for the benchmark of Wie and Bernstein: two masses, a spring, one force.

B. Wie and D. S. Bernstein, Benchmark problems for robust control design, Journal of Guidance,
Control, and Dynamics 15, 1992, problem 1: y = x_2 + noise, stable for every k in [0.5, 2].
The robust law knows how k enters: k_0 + delta is a force that the stretch x_2 - x_1 causes, one
more disturbance and one more error. The plain one believes k_0 = 1.25, as if it were certain.

    python acc_benchmark.py robust|plain FILE
"""

import sys

import control
import ctrlsys
import numpy as np

import flexslew as fs

kind, file = (sys.argv[1:] + ["robust", "robust.npz"][len(sys.argv) - 1 :])[:2]
stiffness = {"robust": 1.0, "plain": 1.25}[kind]
plant = fs.linear_model(
    fs.trial("time_optimal_oscillator", {"testbed.parameters.stiffness": stiffness, "plan": None})
)
names = plant.output_labels
stretch = plant.C[[names.index("tip:spring")]]
x2 = plant.C[[names.index("position:mass")]] + stretch
# a force on the free mass; one in the spring draws the masses together
free = np.array([[0.0], [0.0], [0.0], [1.0]])
spring = np.array([[0.0], [0.0], [-1.0], [2.0]])

# columns: force on the free mass, at the motor, in the spring; rows: x_2, stretch; noise and effort
disturbances = {
    "robust": [0.33 * free, 0.07 * plant.B, 0.7 * spring],
    "plain": [free, 0.003 * plant.B],
}
errors = {"robust": [x2, stretch], "plain": [x2]}
# the noise counts, and the effort; then how far off the least gamma: far off is near LQG
noise, effort, off = {"robust": (1.5, 1.2, 1.05), "plain": (0.93, 3.6, 4.0)}[kind]

b1, c1 = np.hstack(disturbances[kind]), np.vstack(errors[kind])
w, z = b1.shape[1], len(c1)
# fmt: off
b = np.hstack([b1, np.zeros((4, 1)), plant.B])
c = np.vstack([c1, np.zeros((1, 4)), x2])
d = np.block([[np.zeros((z, w + 2))],
              [np.zeros((1, w + 1)), np.array([[effort]])],
              [np.zeros((1, w)), np.array([[noise, 0.0]])]])
# fmt: on


def designed(gamma: float) -> control.StateSpace | None:
    """Return the law for a bound gamma, or None: there is none, or what came does not stabilise."""
    matrices = (np.asfortranarray(part) for part in (plant.A, b, c, d))
    *found, _, info = ctrlsys.sb10fd(4, w + 2, z + 2, 1, 1, gamma, *matrices)
    if info:
        return None
    law = control.ss(*found)  # u = K y
    return law if control.ss(plant.A, b, c, d).lft(law).poles().real.max() < 0.0 else None


low, high = 1e-2, 1e3
while high / low > 1.0001:
    middle = np.sqrt(low * high)
    low, high = (middle, high) if designed(middle) is None else (low, middle)
law = designed(off * high)

fs.save_law(
    control.ss(law.A, law.B @ np.ones((1, 2)), law.C, law.D @ np.ones((1, 2))),  # y is their sum
    file,
    inputs=["position.mass", "tip.spring"],
    outputs=["effort.mass"],
)
