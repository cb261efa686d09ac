# ---
# jupyter:
#   kernelspec: {display_name: Python 3, language: python, name: python3}
# ---

# %% [markdown]
# # From an experiment to a better slew
#
# A floating oscillator has another stiffness and mass than the nominal model. A slew planned on
# the nominal numbers leaves vibration. Run an experiment, identify the bench, plan again.

# %%
import tempfile
from pathlib import Path

import flexslew as fs

BENCH = {"testbed.parameters.stiffness": 0.85, "testbed.parameters.free_mass": 1.2}  # the truth
NOMINAL = fs.trial("replan_oscillator").testbed

# %%
first = fs.fly(fs.trial("replan_oscillator", BENCH | {"plan.model": NOMINAL}))
first.plot("position", "tip", "effort")

# %% [markdown]
# The experiment: a multisine within the limits of the bench, under the same controller. Its plan
# uses the nominal model, too.

# %%
shake = {
    "duration": 125.0,
    "plan": {
        "method": "excitation",
        "model": NOMINAL,
        "band": [0.3, 6.0],
        "largest_excursion": [0.2],
        "duration": 120.0,
    },
}
folder = Path(tempfile.mkdtemp()) / "shake"
shaken = fs.fly(fs.trial("replan_oscillator", BENCH | shake), folder)
shaken.plot("position", "tip", "effort")

# %% [markdown]
# Identification uses the sensors and the efforts of the log, not the truth. Intervals are those
# of 95 %.

# %%
found = fs.identify(folder)
for mode in found.model.modes:
    w, zeta = mode.frequency, mode.damping_ratio
    print(f"frequency {w.value:.5f} rad/s, from {w.low:.5f} to {w.high:.5f}")
    print(f"damping   {zeta.value:.5f}, from {zeta.low:.5f} to {zeta.high:.5f}")
true = (0.85 * (1.0 + 1.0 / 1.2)) ** 0.5
print(f"truth     {true:.5f} rad/s; inertia {found.model.inertia[0][0].value:.4f} of 2.2 kg")

# %% [markdown]
# Plan on the identified model, and run the same bench.

# %%
second = fs.fly(fs.trial("replan_oscillator", BENCH | {"plan.model": found.model_section}))
known = fs.fly(fs.trial("replan_oscillator", BENCH))
for label, flight in (("nominal", first), ("identified", second), ("truth", known)):
    print(f"plan on {label:10} {flight.metrics['residual_tip_deflection']:.5f} m after the end")

assert abs(found.model.modes[0].frequency.value / true - 1.0) < 2e-3
assert second.metrics["residual_tip_deflection"] < 1.5 * known.metrics["residual_tip_deflection"]
assert second.metrics["residual_tip_deflection"] < 0.2 * first.metrics["residual_tip_deflection"]
