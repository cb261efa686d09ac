# ---
# jupyter:
#   kernelspec: {display_name: Python 3, language: python, name: python3}
# ---

# %% [markdown]
# # From a modal file to a pointed telescope
#
# A telescope of 240 kg has two solar panels with a mode at 0.5 Hz. It turns to a target without
# pointing at the Sun. The data of the panels are those of a finite element
# program.

# %%
import json
from pathlib import Path
from tempfile import mkdtemp

import numpy as np
from IPython.display import HTML

import flexslew as fs
from flexslew_lab.report.sky_map import testbed_sky_map

# %% [markdown]
# ## 1. The panel
#
# Frequencies, damping, and the mode shapes of the panel's mass points with its hinge clamped. Here
# they are those of a beam of 3 m along x with 3 kg/m; yours come from the program's output.

# %%
length, count = 3.0, 20
roots = np.array([1.87510407, 4.69409113])  # of a clamped beam, times its length
x = length * (np.arange(count) + 0.5) / count
masses = np.full(count, 9.0 / count)
sigma = (np.cosh(roots) + np.cos(roots)) / (np.sinh(roots) + np.sin(roots))
z = np.outer(roots / length, x)
bend = np.cosh(z) - np.cos(z) - sigma[:, None] * (np.sinh(z) - np.sin(z))
bend[1] -= (bend[1] * masses @ bend[0]) / (bend[0] * masses @ bend[0]) * bend[0]  # orthogonal
bend /= bend[:, -1:]
zero = np.zeros(count)
panel_data = {
    "units": "si",
    "frequencies_hz": [0.5, 3.13],
    "damping_ratios": [0.005, 0.005],
    "rigid": {
        "mass": masses.sum(),
        "first_moment": [masses @ x, 0.0, 0.0],
        "inertia": masses @ x**2 * np.diag([0.0, 1.0, 1.0]),
    },
    "points": np.column_stack((x, zero, zero)),
    "masses": masses,
    "shapes": [np.column_stack((zero, zero, row)) for row in bend],
    "tip": count - 1,
}
file = Path(mkdtemp()) / "panel.yaml"
file.write_text(json.dumps(panel_data, default=np.ndarray.tolist))  # which is YAML, too
print(", ".join(panel_data))

# %% [markdown]
# ## 2. The spacecraft
#
# Three wheels turn it, a gyro and a star tracker measure its attitude, and the telescope, its z
# axis, must stay 25 deg away from the Sun. The attitude filter is
# a multiplicative Kalman filter (`attitude: {}`).


# %%
def panel(side: float) -> dict:
    """Return a panel along y or -y."""
    axes = [[0.0, side, 0.0], [-side, 0.0, 0.0], [0.0, 0.0, 1.0]]
    hinge = {"place": [0.0, side * 0.6, 0.0], "axes": axes}
    return {"hinge": hinge, "shape": {"kind": "modal_data", "file": str(file)}}


CRAFT = {
    "kind": "spacecraft",
    "platform": {"mass": 222.0, "inertia": {"xx": 60.0, "yy": 50.0, "zz": 55.0}},
    "appendages": {"left": panel(1.0), "right": panel(-1.0)},
    "actuators": {},
    "wheels": {
        name: {"axis": axis, "inertia": 0.02, "limit": 0.6, "momentum_limit": 20.0}
        for name, axis in zip(("roll", "pitch", "yaw"), np.eye(3).tolist(), strict=True)
    },
    "sensors": {
        "gyro": {"kind": "gyro", "angle_random_walk": 1e-6, "rate_random_walk": 1e-9},
        "tracker": {
            "kind": "star_tracker",
            "boresight": [0.0, -0.7, -0.7],
            "across": 1e-5,
            "about": 8e-5,
            "interval": 0.5,
        },
    },
    "keep_out": {"sun": {"direction": [0.45, 0.05, 0.88], "half_angle": "25 deg"}},
    "pointing_window": 10.0,
}
KEYS = {
    "name": "telescope",
    "duration": 120.0,
    "period": 0.05,
    "testbed": CRAFT,
    "plan": {
        "method": "time_optimal",
        "drives": "all",
        "reserve": 0.3,
        "goal": {"to": [0.95, 0.1, 0.3]},
    },
    "controllers": {
        "pd_feedforward": {
            "kp": [8.0],
            "kd": [45.0],
            "gyroscopic": True,
            "attitude": {},
        }
    },
    "active": "pd_feedforward",
}
telescope = fs.trial(KEYS)
model = fs.linear_model(telescope)
print(model.ninputs, "wheels,", model.nstates, "states")

# %% [markdown]
# ## 3. The slew
#
# The fastest turn about the eigenaxis enters the cone about the Sun: it is refused, with time and
# depth. With `drives: all` the plan avoids the cone and brings all modes to rest.

# %%
try:
    fs.plan(fs.trial(KEYS, {"plan.drives": "moving"}))
except fs.PlanFailed as refused:
    print(refused)

plan = fs.plan(telescope)
print(
    f"{plan.duration:.2f} s; rigid, with the Sun elsewhere {plan.summary['rigid_duration']:.2f} s"
)

# %%
flight = fs.fly(fs.trial(KEYS, plan=plan))
margin = np.degrees(flight.metrics["keep_out_margin"]["sun"])
print(f"{margin:.2f} deg away from the cone; {flight.verdict}")
assert margin > 0.0
HTML(testbed_sky_map(telescope.testbed, flight["coordinate"], plan.position))

# %% [markdown]
# ## 4. The pointing
#
# After the slew: the absolute, mean and relative performance errors of ECSS-E-ST-60-10C about the
# body axes, with windows of 10 s.

# %%
for key in ("absolute_performance_error", "mean_performance_error", "relative_performance_error"):
    print(f"{key:30}", " ".join(f"{1e6 * e:8.2f}" for e in flight.metrics[key]), "urad")
assert max(flight.metrics["absolute_performance_error"]) < 5e-3
flight.plot("tip", "effort")

# %% [markdown]
# Next: `./flexslew analyse` on a trial file with these keys states the margins,
# [studies](../studies/run.md) run hundreds of such spacecraft against requirements, and the trial
# `observatory` adds thrusters, a wheel pyramid, an orbit and fine pointing.
