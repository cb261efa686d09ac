"""The chance of a fault, tick by tick and at once."""

import numpy as np
import pytest

from flexslew_plant.faults.chance import key_of, random_number, random_numbers


@pytest.mark.parametrize("seed", range(20))
def test_all_ticks_at_once_are_drawn_as_numpy_draws_each(seed: int) -> None:
    rng = np.random.default_rng(seed)
    bits = rng.integers(1, 63, size=rng.integers(1, 8))
    key = tuple(int(rng.integers(0, 1 << int(most))) for most in bits)
    first = int(rng.integers(0, 1 << 20))
    each = [random_number(key, tick) for tick in range(first, first + 40)]
    assert random_numbers(key, first, first + 40).tolist() == each


def test_no_ticks_are_drawn_as_nothing() -> None:
    assert random_numbers((1,), 5, 5).size == random_numbers((1,), 5, 3).size == 0


def test_faults_of_one_trial_have_a_chance_of_their_own() -> None:
    keys = {
        key_of(seed, 0, start, kind, own)
        for seed in (1, 2)
        for start in (0, 1)
        for kind in ("command_lost", "command_late")
        for own in (0, 1)
    }
    assert len({random_numbers(key, 0, 1)[0] for key in keys}) == len(keys) == 16
