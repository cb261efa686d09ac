# ---
# jupyter:
#   kernelspec: {display_name: Python 3, language: python, name: python3}
# ---

# %% [markdown]
# # From model to margin to flight
#
# Export a linear model, design a law with python-control, compute the margins of the
# running code, test them in flight, then run the manoeuvre. The bench is the floating oscillator:
# a driven mass, a spring, a free mass.

# %%
import tempfile
from pathlib import Path

import control
import numpy as np

import flexslew as fs

keys = {
    "name": "designed",
    "period": 0.02,
    "duration": 40.0,
    "testbed": {"kind": "floating_oscillator", "damping_ratio": 0.005},
    "plan": {
        "method": "reference_only",
        "goal": {"mass": 1.0},
        "duration": 12.0,
        "feedback": {"kp": [0.5], "kd": [1.0]},
    },
}
plant = fs.linear_model(fs.trial(keys), sampled=True)
plant.input_labels, plant.output_labels, abs(np.log(plant.poles())) / plant.dt

# %% [markdown]
# ## A design
#
# A regulator and a filter with the position of the driven mass alone. The model is the sampled
# one of the bench, so the design is exact. A law's input is the error, the reference minus
# the measurement.

# %%
a, b, c = plant.A, plant.B, plant.C[[plant.output_labels.index("position:mass")]]
regulator, _, _ = control.dlqr(a, b, np.diag([1.0, 1.0, 0.1, 1.0]), np.eye(1))
observer, _, _ = control.dlqe(a, b, c, np.eye(1), 0.1 * np.eye(1))
law = control.ss(a - b @ regulator - observer @ c, -observer, -regulator, 0, plant.dt)

file = Path(tempfile.mkdtemp()) / "law.npz"
fs.save_law(law, file, inputs=["error.mass"], outputs=["effort.mass"])

# %% [markdown]
# ## Its margins
#
# These are not of the matrices above, but of the running controller by perturbation.

# %%
mine = fs.trial({**keys, "controllers": {"linear": {"file": str(file)}}, "active": "linear"})
found = fs.analyse(mine)
(margins,) = found.efforts
print(f"gain {margins.gain_down:.2f} to {margins.gain_up:.2f}, delay {margins.delay:.3f} s")
print(f"disk margin {found.disks['input'].alpha:.2f}; worst over +-20 %: {found.worst.alpha:.2f}")
assert found.stable

# %% [markdown]
# ## Test of the margins
#
# The nonlinear bench runs just inside and just outside of each.

# %%
proof = fs.prove(mine, found)
for margin in proof.margins:
    print(f"{margin.kind:9} predicted {margin.predicted:.4f}, flown {margin.flown:.4f}")
assert proof.holds

# %% [markdown]
# ## The flight

# %%
flight = fs.fly(mine)
flight.plot("position", "tip", "effort")

# %%
late = flight.time > 30.0
assert abs(flight["position.mass"][late] - 1.0).max() < 0.05
