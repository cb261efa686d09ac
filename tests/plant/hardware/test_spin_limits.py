"""Wheels keep to their speed: what the log says of their motors is what acted, at every tick."""

import numpy as np
import pytest

from flexslew_lab.notebook import trial
from flexslew_lab.trial.trial import bench_settings
from flexslew_plant.bench.bench import Bench
from flexslew_plant.measurement import EffortCommand

PERIOD, INERTIA, LIMIT = 0.02, 0.02, 0.5  # [s], [kg m^2], [N m] of the wheels of three_axes
WHEEL, BODY = 6, 3  # where the rates of the wheels stand in v, and the body rates
LEAST = 30.0  # of the craft's inertias, which the wheels turn against [kg m^2]


@pytest.mark.parametrize("seed", range(4))
def test_no_tick_gives_more_than_the_motor_or_takes_a_wheel_beyond_its_limit(seed: int) -> None:
    rng = np.random.default_rng([seed, 311])
    most = rng.uniform(0.2, 0.5, 3)  # of the momenta [N m s]
    changes = {
        f"testbed.wheels.{name}.momentum_limit": float(value)
        for name, value in zip(("roll", "pitch", "yaw"), most, strict=True)
    }
    limited = trial("three_axes", changes | {"plan": None, "duration": 4.0})
    bench = Bench(bench_settings(limited))
    given, reached = [], np.zeros(3)
    rates = [bench.truth().velocity]
    push = np.zeros(3)
    while not bench.done:
        if bench.tick % 60 == 0:  # longer than it takes to a limit
            push = rng.uniform(0.6, 1.2, 3) * rng.choice([-1.0, 1.0], 3) * LIMIT
        asked = bench.question
        bench.offer(EffortCommand(asked.tick, asked.epoch, asked.controller, push))
        bench.advance()
        truth = bench.truth()
        given.append(truth.applied_effort)
        rates.append(truth.velocity)
        stored = INERTIA * truth.velocity[WHEEL : WHEEL + 3]
        beyond = abs(stored) - most
        # the platform's own turn meanwhile, as no motor holds that
        assert beyond.max() < 2.0 * INERTIA * 3 * LIMIT / LEAST * bench.time
        reached += beyond > -1e-9
    spun = np.array(rates)
    absolute = INERTIA * (spun[:, WHEEL : WHEEL + 3] + spun[:, BODY : BODY + 3])
    # a wheel's momentum about its own axis changes by its motor alone
    np.testing.assert_allclose(np.diff(absolute, axis=0), -PERIOD * np.array(given), atol=1e-13)
    assert np.abs(given).max() <= LIMIT
    assert (reached > 0).all()
