# ---
# jupyter:
#   kernelspec: {display_name: Python 3, language: python, name: python3}
# ---

# %% [markdown]
# # The least vibration over the duration of a slew
#
# A mass of 1 kg with another one on a spring moves by 1 m with 1 N. The stiffness varies by up to
# 20 %. What is the smallest worst-case residual for a duration? For a linear plant the
# answer has a [certificate](../theory/optimum.md).

# %%
import numpy as np
from plotly.graph_objects import Figure, Scatter

import flexslew as fs

PD = {"kp": [0.5], "kd": [1.0]}
SECTION = {"method": "minimax_feedforward", "goal": {"mass": 1.0}, "feedback": PD}
KEYS = {"testbed": {"kind": "floating_oscillator"}, "period": 0.01}
KEYS |= {"plan": SECTION, "controllers": {"pd_feedforward": PD}, "active": "pd_feedforward"}


def planned(**keys: object) -> fs.Plan:
    """Return the plan with some keys of its section."""
    return fs.plan(fs.trial(KEYS, {f"plan.{key}": value for key, value in keys.items()}))


# %% [markdown]
# Without feedback only the planned efforts bring the masses to rest. Feedback also reacts to model
# errors, which is not always an advantage.

# %%
durations = np.array([5.0, 6.0, 7.0, 8.0, 9.0, 10.0, 12.0])
cases = {
    "under the PD": {},
    "no feedback": {"feedback": {"kp": [0.0], "kd": [0.0]}},
    "no feedback, exact at nominal": {
        "feedback": {"kp": [0.0], "kd": [0.0]},
        "exact_nominal": True,
    },
}
worst = {
    name: [planned(duration=t, **keys).summary["worst_residual"] for t in durations]
    for name, keys in cases.items()
}
figure = Figure([Scatter(x=durations, y=values, name=name) for name, values in worst.items()])
figure.update_yaxes(type="log", title_text="residual tip deflection on the worst plant [m]")
figure.update_xaxes(title_text="duration [s]")
figure

# %%
for name, values in worst.items():
    print(f"{name:32}" + "".join(f"{value:10.2g}" for value in values))

assert all(np.diff(values).max() < 0.0 for values in worst.values())  # more time is never worse

# %% [markdown]
# The inverse problem: the shortest slew with a residual below 1 mm, and its effort.

# %%
shortest = planned(residual_bound=1e-3, duration=20.0)
cheaper = planned(duration=shortest.duration + 2.0, rho=1e-4)
for plan in (shortest, cheaper):
    effort = float(np.sum(plan.effort**2) * plan.period)
    print(f"{plan.duration:.2f} s, {plan.summary['worst_residual']:.2g} m, {effort:.3g} N^2 s")

# %% [markdown]
# A test of the prediction: a bench with a spring that is 20 % too soft.

# %%
changes = {
    "testbed.parameters.stiffness": 0.8,
    "plan.model": {"parameters": {"stiffness": 1.0}},
    "plan.duration": 10.0,
    "duration": 40.0,
}
flight = fs.fly(fs.trial(KEYS, changes))
promised = planned(duration=10.0).summary["worst_residual"]
print(f"promised {promised:.3g} m, flown {flight.metrics['residual_tip_deflection']:.3g} m")
assert flight.metrics["residual_tip_deflection"] <= 1.01 * promised
flight.plot("position", "tip")
