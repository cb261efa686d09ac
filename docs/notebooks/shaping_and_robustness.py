# ---
# jupyter:
#   kernelspec: {display_name: Python 3, language: python, name: python3}
# ---

# %% [markdown]
# # Shaping and robustness
#
# Three planners on one manoeuvre, with beams stiffer or softer than in the plan.

# %%
import numpy as np
from plotly.graph_objects import Figure, Scatter

import flexslew as fs

NOMINAL = 1500.0  # bending stiffness in every plan [N m^2]
GOAL = {"base_yaw": 1.0, "hub_pitch": 0.5}
PLANS = {
    "reference only": {"method": "reference_only"},
    "input shaping": {"method": "input_shaping"},
    "optimized feedforward": {"method": "optimized_feedforward"},
}


def residual(plan: dict[str, str], factor: float) -> float:
    """Return the largest tip deflection after the manoeuvre [m], at factor times the stiffness."""
    keys = {
        "duration": 60.0,
        "testbed": {"parameters": {"bending_stiffness": factor * NOMINAL}},
        "plan": {
            **plan,
            "goal": GOAL,
            "duration": 25.0,
            "model": {"modes": 1, "parameters": {"bending_stiffness": NOMINAL}},
        },
    }
    return fs.fly(fs.trial(keys)).metrics["residual_tip_deflection"]


# %% [markdown]
# The stiffness varies by up to 20 %.

# %%
factors = np.array([0.8, 1.0, 1.2])
residuals = {name: [residual(plan, f) for f in factors] for name, plan in PLANS.items()}

figure = Figure([Scatter(x=factors, y=values, name=name) for name, values in residuals.items()])
figure.update_yaxes(type="log", title_text="residual tip deflection [m]")
figure.update_xaxes(title_text="stiffness of the bench over that of the plan")
figure

# %%
for name, values in residuals.items():
    print(f"{name:24}" + "".join(f"{value:9.4f}" for value in values))

assert residuals["optimized feedforward"][1] < 0.1 * residuals["reference only"][1]
