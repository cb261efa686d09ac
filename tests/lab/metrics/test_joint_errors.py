"""Errors of the joints at the end of the manoeuvre."""

import numpy as np

from flexslew_lab.metrics.joint_errors import JointErrors
from flexslew_lab.metrics.metric import Block, Ending, ReferenceManoeuvre, RunSetup
from flexslew_lab.reproduce.scole_flights import example_trial


def test_a_wheel_that_spins_on_is_no_error_at_the_end() -> None:
    testbed = example_trial("own_spacecraft").testbed
    model = testbed.model()
    joints = len(model.joint_names)
    q, v = model.rest({})[None], np.zeros((1, model.coordinates))
    v[0, model.before_modes - 1] = 40.0  # its wheel [rad/s]
    v[0, -1] = 0.5  # a mode
    none = np.zeros((1, joints))
    yes = np.ones(1, dtype=bool)
    setup = RunSetup(
        tuple(model.joint_names), ReferenceManoeuvre(0.0, 1.0, none[0], none[0]), none[0], testbed
    )
    metric = JointErrors(setup)
    tip = np.zeros((1, len(model.appendages.names)))
    metric.add(Block(np.array([9]), np.array([1.0]), np.ones(1), q, v, none, tip, none, yes, yes))
    assert metric.result(Ending([], [], True))["terminal_error_norm"] == 0.5
