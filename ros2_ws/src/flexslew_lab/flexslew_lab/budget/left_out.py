"""What a trial has and its pointing budget has not, in words."""

from typing import Any

from flexslew_lab.budget.quantisation import DITHER
from flexslew_lab.budget.sources import ObservedLoop
from flexslew_plant.hardware.sensors import Readings

_LINEAR = ("slew_rate", "shortest_pulse")  # keys of motors that no source is made of


def left_out(at: ObservedLoop) -> tuple[str, ...]:
    """Return one line for each part of the bench that the budget leaves out or simplifies."""
    trial, model = at.trial, at.loop.point.rest.model
    words = [
        f"actuator.{key}: the motors of the noise paths have none"
        for key in _LINEAR
        if (given := getattr(trial.actuator, key)) and (not isinstance(given, dict) or any(given))
    ]
    if model.one_way:
        words.append("thrusters push one way: the noise paths take them as pushing both ways")
    if model.time_varying:
        words.append("the plant turns with time: the noise paths have it as the observation begins")
    if trial.plausibility is not None:
        words.append("plausibility: the drive's check of joint sensors")
    switches = [e.at for e in trial.schedule if e.switch and e.at > at.windows.first * trial.period]
    if switches:
        words.append(f"switches of the controller at {', '.join(f'{t:g} s' for t in switches)}")
    for one in model.appendages.instruments:
        settings: Any = getattr(one, "settings", None)
        if getattr(settings, "rate_noise", None):
            words.append(f"testbed.sensors.{one.name}.rate_noise: the platform is taken at rest")
        if getattr(settings, "blind", None):
            words.append(f"testbed.sensors.{one.name}.blind: the filter always has readings")
    for key in Readings._fields:
        channel = getattr(trial.sensors, key)
        if 0.0 < channel.noise < DITHER * channel.quantisation:
            words.append(f"sensors.{key}.quantisation: flown without the noise of the channel")
    if at.loop.no_estimate:
        words.append(f"errors of knowledge: {at.loop.no_estimate}")
    words += list(at.loop.point.warnings)
    return tuple(words)
