"""A shaper for two modes: zero vibration for each, as a planner of one's own."""

import numpy as np

from flexslew_control.plan import Plan
from flexslew_plant.settings import section


@section
class Shaper:
    """Its keys in the `plan` section."""

    method: str
    goal: dict[str, float]  # [rad or m]
    start: float = 0.0  # [s]
    duration: float = 20.0  # of the command before it is shaped [s]

    def plan(self, slew, progress):
        """Return the shaped slew; the reference is the model's own flight under its efforts."""
        model, m, n = slew.model, slew.model.joints, slew.model.coordinates
        linear = model.linearise(model.rest(slew.named(slew.goal)))
        waits = np.pi / linear.frequencies[:2]  # half a period of each mode
        delays = np.zeros(1)
        for wait in waits:  # two impulses for each mode
            delays = np.append(delays, delays + wait)
        ticks = int(np.ceil((self.duration + waits.sum()) / slew.period))
        s = np.clip((slew.period * np.arange(ticks + 1)[:, None] - delays) / self.duration, 0, 1)
        rate = (6.0 * s * (1.0 - s)).mean(axis=1) / self.duration
        torque = linear.mass[:m, :m] @ (slew.goal - slew.start)
        effort = np.outer(np.diff(rate) / slew.period, torque)
        x = [np.append(slew.start, np.zeros(2 * n - m))]
        for u in effort:
            x.append(model.advance(x[-1], u, slew.period))
        x[-1][:m], x[-1][n : n + m] = slew.goal, 0.0  # but for what shaping leaves
        q, v, end = np.array(x)[:, :m].copy(), np.array(x)[:, n : n + m].copy(), ticks * slew.period
        names, none = model.joint_names, np.zeros((ticks + 1, 0))
        return Plan(self.method, names, self.start, slew.period, q, v, effort, none, end)
