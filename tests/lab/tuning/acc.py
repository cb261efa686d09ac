"""A tuning of the ACC benchmark: a controller of order 2 for two values of the stiffness."""

from typing import Any

STIFFNESS = "testbed.parameters.stiffness"
ACC: dict[str, Any] = {
    "tuning": "acc", "trial": "acc_benchmark", "controller": "order_2",
    "structure": {"kind": "state_space", "order": 2, "outputs": {"effort.mass": 1.0},
                  "inputs": {"position.mass + tip.spring": 1.0}},
    "models": [{}, {STIFFNESS: 0.8}],
    "goals": [{"goal": "margin", "disk": 0.3}, {"goal": "poles", "decay": 0.05}],
    "starts": 3, "evaluations": 300,
}  # fmt: skip
FAST = {"goal": "poles", "decay": 0.5}
