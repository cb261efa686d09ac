"""PD with a notch at the second elastic mode, for M1: it asks nothing of the motors there.

K(s) = (kp + kd s / (1 + s / w_f)) (s^2 + 2 z_1 w s + w^2) / (s^2 + 2 z_2 w s + w^2) per joint.
"""

import sys

import control
import numpy as np

import flexslew as fs

plant = fs.linear_model(fs.trial("m1"), hub_pitch=0.5)
elastic = np.unique(np.round(abs(plant.poles()), 6))
w = float(elastic[elastic > 1.0][0])  # the first above the PD's own bandwidth [rad/s]

s = control.tf("s")
notch = (s**2 + 2 * 0.1 * w * s + w**2) / (s**2 + 2 * 0.7 * w * s + w**2)
pd = 460.0 + 920.0 * s / (1 + s / 30.0)  # N m/rad and N m s/rad as shipped, rate up to 30 rad/s

joints = ["base_yaw", "hub_pitch"]
one = control.ss(pd * notch)
fs.save_law(
    control.append(one, one),
    sys.argv[1] if len(sys.argv) > 1 else "pd_notch.npz",
    inputs=[f"error.{joint}" for joint in joints],
    outputs=[f"effort.{joint}" for joint in joints],
)
