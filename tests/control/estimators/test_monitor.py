"""Tests of innovations: as rarely wrong as stated, and quick to see what is not there."""

import numpy as np
import pytest
from tests.present import present

from flexslew_control.controllers import build_controller
from flexslew_control.estimators.monitor import Monitor, MonitorSettings, channel_name
from flexslew_control.law import PlantDescription
from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds import default_testbed

PERIOD = 0.01  # [s]
CHANNELS = 4
TICKS = 20_000


def alarms(rate: float, window: int, seed: int) -> int:
    """Return how often a monitor is wrong about innovations that are as stated."""
    rng = np.random.default_rng(seed)
    variance = np.array([1e-8, 1e-6, 1.0, 100.0])
    innovations = rng.standard_normal((TICKS, CHANNELS)) * np.sqrt(variance)
    monitor = Monitor(MonitorSettings(false_alarms=rate, window=window), PERIOD)
    return sum(monitor.take(e, variance) is not None for e in innovations)


@pytest.mark.parametrize("window", [2, 20, 200])
def test_false_alarms_are_as_frequent_as_stated(window: int) -> None:
    hours = TICKS * PERIOD / 3600.0
    expected = 100
    found = alarms(expected / hours, window, seed=window)
    assert abs(found - expected) < 4.0 * np.sqrt(expected)  # four sigma of a Poisson count


def test_at_its_default_it_stays_silent() -> None:
    assert alarms(MonitorSettings().false_alarms, MonitorSettings().window, seed=7) == 0


@pytest.mark.parametrize("size", [1.5, 3.0, 10.0, 1e3])
@pytest.mark.parametrize("channel", range(CHANNELS))
def test_a_bias_is_seen_in_its_channel_the_sooner_the_larger(channel: int, size: float) -> None:
    rng = np.random.default_rng(channel)
    monitor, window = Monitor(MonitorSettings(), PERIOD), MonitorSettings().window
    bias = np.zeros(CHANNELS)
    bias[channel] = size  # in sigmas
    allowed = {1.5: 200 * window, 3.0: 2 * window, 10.0: 2, 1e3: 1}[size]
    readings = rng.standard_normal((allowed, CHANNELS)) + bias
    found = (monitor.take(e, np.ones(CHANNELS)) for e in readings)
    doubt = next(one for one in found if one is not None)
    assert doubt.channel == channel
    assert doubt.statistic > doubt.limit


def test_a_reset_forgets_the_window() -> None:
    monitor, ones = Monitor(MonitorSettings(window=4), PERIOD), np.ones(1)
    large = 3.5 * ones
    for _ in range(3):
        assert monitor.take(large, ones) is None
    monitor.reset()
    assert monitor.take(large, ones) is None
    for _ in range(2):
        monitor.take(large, ones)
    assert present(monitor.take(large, ones)).ticks == 4


def test_channels_have_the_names_of_their_joints() -> None:
    joints = ("base", "arm")
    names = [channel_name(number, joints) for number in range(5)]
    assert names[:2] == ["position of base", "position of arm"]
    assert names[2:] == ["velocity of base", "velocity of arm", "output 4"]


def test_a_law_without_innovations_has_nothing_to_monitor() -> None:
    plant = PlantDescription(default_testbed(), PERIOD, np.array([150.0, 150.0]))
    with pytest.raises(BadInput, match=r"monitor: pd_feedforward has no innovations.*plausib"):
        build_controller("pd", "pd_feedforward", {"monitor": {}}, plant, "test")
    with pytest.raises(BadInput, match="false_alarms"):
        build_controller("lqr", "lqr", {"monitor": {"false_alarms": 0.0}}, plant, "test")
