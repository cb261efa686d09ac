"""Mixed sensitivity for M1: an H-infinity law by ctrlsys (SLICOT) that rolls off above w_r.

|T from (d, n) to (W_1 y, W_2 u)| < gamma: d torques at the motors, n noise of the encoders;
W_1 asks for small positions (S G and T), W_2 for small torques that roll off (T and K S).

The plant is the sampled bench in the plane of Tustin's map, z = (1 + s h / 2) / (1 - s h / 2): the
law comes back by the same map, so its hold and its delay count without an approximation.
"""

import sys

import control
import ctrlsys
import numpy as np

import flexslew as fs

bench = fs.linear_model(fs.trial("m1"), sampled=True, hub_pitch=0.5)
joints = ["base_yaw", "hub_pitch"]
rows = [bench.output_labels.index(f"position:{joint}") for joint in joints]
half = np.linalg.inv(bench.A + np.eye(bench.nstates))
a = 2.0 / bench.dt * half @ (bench.A - np.eye(bench.nstates))
b = 2.0 / np.sqrt(bench.dt) * half @ bench.B
c = 2.0 / np.sqrt(bench.dt) * bench.C[rows] @ half
d = -bench.C[rows] @ half @ bench.B
n, m = b.shape

torque, noise = 10.0 * np.eye(m), 0.01 * np.eye(m)  # [N m], [rad]
position = 20.0 * np.eye(m)  # W_1 [1/rad]
corner, top = 2.0, 200.0  # of W_2: w_r, and where it is flat again, which keeps it proper [rad/s]
s = control.tf("s")
roll_off = control.ss((1 / 30.0) * (1 + s / corner) / (1 + s / top))  # [1/(N m)]
w2 = control.append(roll_off, roll_off)
k = w2.nstates

zero = np.zeros
# fmt: off
big_a = np.block([[a, zero((n, k))], [zero((k, n)), w2.A]])
big_b = np.block([[b @ torque, zero((n, m)), b], [zero((k, 2 * m)), w2.B]])
big_c = np.block([[position @ c, zero((m, k))], [zero((m, n)), w2.C], [c, zero((m, k))]])
big_d = np.block([[position @ d @ torque, zero((m, m)), position @ d],
                  [zero((m, 2 * m)), w2.D],
                  [d @ torque, noise, d]])
# fmt: on
# Balanced: in the states of the bench rounding alone moves the law by one part in 1e4.
fortran = np.asfortranarray  # a copy in the order of SLICOT
balanced = ctrlsys.tb01id("A", fortran(big_a), fortran(big_b), fortran(big_c), 0.0)[:3]
gamma = 1.12  # the least is about .76, but near it K grows, and rounding decides what it is
*law, _, info = ctrlsys.sb10fd(n + k, 3 * m, 3 * m, m, m, gamma, *balanced, fortran(big_d))
law = control.ss(*law)  # u = K y
poles = control.ss(big_a, big_b, big_c, big_d).lft(law).poles()
if info or poles.real.max() >= 0.0:
    raise SystemExit(f"no law with a gamma of {gamma}")

fs.save_law(
    control.ss(law.A, -law.B, law.C, -law.D),
    sys.argv[1] if len(sys.argv) > 1 else "mixed_sensitivity.npz",
    inputs=[f"error.{joint}" for joint in joints],
    outputs=[f"effort.{joint}" for joint in joints],
)
