"""Compile every kernel once, so that no run pays for it."""

import numpy as np

from flexslew_plant.testbeds import TESTBEDS, build_model, default_testbed

if __name__ == "__main__":
    for kind in TESTBEDS:
        model = build_model(default_testbed(kind))
        x, u = np.zeros(2 * model.coordinates), np.zeros(model.joints)
        model.advance(x, u, 0.01)
        model.jacobian(x, u)
        model.energy(x)
