# ---
# jupyter:
#   kernelspec: {display_name: Python 3, language: python, name: python3}
# ---

# %% [markdown]
# # First flight
#
# Plan a slew of the two-motor testbed, simulate it in this process, and plot the beams.

# %%
import flexslew as fs

m1 = fs.trial("m1", {"duration": 60.0})
flight = fs.fly(m1)
flight.plot("position", "tip", "effort")

# %% [markdown]
# Every signal has a name and a unit.

# %%
for name in ("position.base_yaw", "velocity.mode_1", "effort.hub_pitch", "energy"):
    print(f"{name:20} [{flight.units[name]}], {len(flight[name])} ticks")

# %% [markdown]
# The same reference without the planned feedforward: only the method of the plan differs.

# %%
plan = {"goal": {"base_yaw": 1.0, "hub_pitch": 0.5}, "duration": 25.0, "method": "reference_only"}
bare = fs.fly(fs.trial({"name": "bare", "duration": 60.0, "plan": plan}))

for label, run in (("planned", flight), ("without feedforward", bare)):
    print(f"{label:20} {run.metrics['residual_tip_deflection']:8.4f} m at the tip after the end")

assert flight.metrics["residual_tip_deflection"] < 0.05
assert bare.metrics["residual_tip_deflection"] > 1.0
