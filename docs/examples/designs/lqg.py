"""LQG for M1: a discrete regulator and a Kalman filter of python-control, as a law for the bench.

u = -K x, x+ = A x + B u + L (y - C x) with y = -error, about hub_pitch = 0.5 rad with all
three modes: a design with one lets the second grow, which `./flexslew analyse` shows.
"""

import sys

import control
import numpy as np

import flexslew as fs

plant = fs.linear_model(fs.trial("m1"), sampled=True, hub_pitch=0.5)
joints = ["base_yaw", "hub_pitch"]
rows = [plant.output_labels.index(f"position:{joint}") for joint in joints]
a, b, c = plant.A, plant.B, plant.C[rows]

# an error of 0.1 rad weighs as 100 N m
regulator, _, _ = control.dlqr(a, b, c.T @ c / 0.1**2, np.eye(2) / 100.0**2)
# of a filter that predicts: disturbances of 1 N m at the motors, 1e-3 rad at the encoders
filter_gain, _, _ = control.dlqe(a, b, c, np.eye(2), 1e-3**2 * np.eye(2))

law = control.ss(a - b @ regulator - filter_gain @ c, -filter_gain, -regulator, 0, plant.dt)
fs.save_law(
    law,
    sys.argv[1] if len(sys.argv) > 1 else "lqg.npz",
    inputs=[f"error.{joint}" for joint in joints],
    outputs=[f"effort.{joint}" for joint in joints],
)
