"""Settings of controllers while they work: by service and as parameters."""

from json import dumps  # which is YAML, in one line
from typing import Any

import numpy as np
from flexslew_msgs import srv
from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.parameter import Parameter, parameter_value_to_python

from .desk import WHO, Acts, Desk

WRONG = {"handover_time": -1.0}


class Settings:
    """Acts on settings."""

    def __init__(self, desk: Desk) -> None:
        self._desk, self._bench = desk, desk.bench
        self.acts: Acts = {self.tune: 2.0, self.set_parameters: 2.0, self.tunings_at_once: 1.0}

    def tune(self) -> str:
        """What is granted is what the parameters say, and nothing else."""
        name, changes, good = self._drawn()
        if not name:
            return "nobody lives"
        nested = any("." in key for key in changes)
        if nested or self._desk.chance(0.5):
            reply = self._desk.ask(srv.Tune, f"{name}/tune", values=_typed(changes), who=WHO)
        else:
            reply = self._desk.ask(srv.Tune, f"{name}/tune", settings=dumps(changes), who=WHO)
        self._desk.granted(reply.ok, reply.message, good)
        self._kept(name, changes, good)
        return f"{name}: {reply.message}"

    def set_parameters(self) -> str:
        """The same as ROS parameters."""
        name, changes, good = self._drawn()
        if not name:
            return "nobody lives"
        service = f"{name}/set_parameters"
        reply = self._desk.ask(SetParameters, service, parameters=_typed(changes))
        for result in reply.results:
            self._desk.granted(result.successful, result.reason, good)
        self._kept(name, changes, good)
        return f"{name}: {changes} {'; '.join(result.reason for result in reply.results)}"

    def tunings_at_once(self) -> str:
        """Two operators tune one controller: both are granted, the parameters are those of one."""
        if not self._bench.alive:
            return "nobody lives"
        name, times = self._desk.pick(self._bench.alive), (0.2, 0.4)
        asked = ({"settings": dumps({"handover_time": t}), "who": "bob"} for t in times)
        one, other = self._bench.both(srv.Tune, f"{name}/tune", *asked)
        assert (one.ok, other.ok) == (True, True), (one, other, self._desk.diary)
        (kept,) = self._found(name, ["handover_time"])
        assert kept in times, (kept, self._desk.diary)
        return f"{name}: {one.message}; {other.message}"

    def _drawn(self) -> tuple[str, dict[str, Any], bool]:
        """Return who is tuned (empty: nobody lives), to what, and whether that is allowed."""
        if not self._bench.alive:
            return "", {}, False
        name, wrong = self._desk.pick(self._bench.alive), self._desk.chance(0.15)
        return name, WRONG if wrong else self._desk.pick(self._desk.habits.tunings[name]), not wrong

    def _kept(self, name: str, changes: dict[str, Any], good: bool) -> None:
        """See that the parameters are what was granted, or not what was refused."""
        for found, asked in zip(self._found(name, list(changes)), changes.values(), strict=True):
            same = np.array_equal(np.asarray(found), np.asarray(asked))
            assert same == good, (name, changes, found, self._desk.diary)

    def _found(self, name: str, keys: list[str]) -> list[Any]:
        reply = self._desk.ask(GetParameters, f"{name}/get_parameters", names=keys)
        return [parameter_value_to_python(value) for value in reply.values]


def _typed(changes: dict[str, Any]) -> list[Any]:
    return [Parameter(key, value=value).to_parameter_msg() for key, value in changes.items()]
