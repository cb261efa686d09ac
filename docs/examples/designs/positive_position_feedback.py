"""Positive position feedback of a tip, beside the PD of M1: it damps the second elastic mode.

x'' + 2 z w x' + w^2 x = w^2 tip, u = PD + g x at base_yaw (C. J. Goh and T. K. Caughey, On the
stability problem caused by finite actuator dynamics in the collocated control of large space
structures, International Journal of Control 41, 1985).
"""

import sys

import control
import numpy as np

import flexslew as fs

plant = fs.linear_model(fs.trial("m1"), hub_pitch=0.5)
elastic = np.unique(np.round(abs(plant.poles()), 6))
w = float(elastic[elastic > 1.0][0])  # the first above the PD's own bandwidth [rad/s]
z, g = 0.1, 20.0  # [-], [N m per m]

law = control.ss(
    [[0, 1], [-(w**2), -2 * z * w]],
    [[0, 0, 0, 0, 0], [0, 0, 0, 0, w**2]],
    [[g, 0], [0, 0]],
    [[460, 0, 920, 0, 0], [0, 460, 0, 920, 0]],
)
fs.save_law(
    law,
    sys.argv[1] if len(sys.argv) > 1 else "positive_position_feedback.npz",
    inputs=["error.base_yaw", "error.hub_pitch", "error_rate.base_yaw", "error_rate.hub_pitch",
            "tip.beam_positive"],
    outputs=["effort.base_yaw", "effort.hub_pitch"],
)  # fmt: skip
