"""Requests of clients, completed by what is known of the bench."""

from collections.abc import Callable, Mapping, Sequence
from math import ceil
from typing import Any, NamedTuple, Protocol

from flexslew_control.plan_service.planning import PlanRequest, StartOfPlan, plan_request
from flexslew_control.planners.input_shaping.section import InputShaping
from flexslew_plant.errors import BadInput
from flexslew_plant.own_code import Trust
from flexslew_plant.refusal import NO_TESTBED, Refusal
from flexslew_plant.settings import validated
from flexslew_plant.testbeds import model_of, read_testbed
from flexslew_plant.yaml_data import load_yaml

_OF_THE_TRAJECTORY = {"goal", "trajectory", "start", "duration", "command", "initial", "method"}
ASSUMPTIONS = _MODEL, _SHAPING = "model", "shaping"  # texts that may be set while the node runs
START_MARGIN = 1.0  # until a plan requested now can start [wall s]


class Clock(Protocol):
    """The simulated time of a bench, as far as it is known."""

    @property
    def has_state(self) -> bool:
        """Whether a state of the bench is known."""

    @property
    def epoch(self) -> int:
        """Number of resets."""

    @property
    def last_tick(self) -> int:
        """Tick at which the run ends; zero: only when it is stopped."""

    @property
    def running(self) -> bool:
        """Whether ticks pass."""

    def now(self) -> float:
        """Return the simulated time [s]."""

    def later(self, wait: float) -> float:
        """Return how much simulated time passes in a wall time at least as at real time [s]."""


class AnnouncedTestbed(NamedTuple):
    """What plans need of a flexslew_msgs/Testbed."""

    settings: str = ""  # YAML; empty: not known
    period: float = 0.0  # one tick [s]
    effort_limit: tuple[float, ...] = ()  # one per actuator [N m or N]
    joint_names: tuple[str, ...] = ()


class PlanRequests:
    """Adds to a request what its client may leave out.

    Args:
        clock: clock of the bench.
        trust: classes of the user's own that testbed and requests may name.
        beginning: returns what is known of the bench at a plan's start [s].

    Attributes:
        testbed: what stands on the bench; without settings: not known.
        shaping: keys of input_shaping with which trajectories are shaped; empty: they are not.
    """

    def __init__(
        self,
        clock: Clock,
        trust: Trust,
        beginning: Callable[[float], StartOfPlan],
    ) -> None:
        self._clock, self._trust, self._beginning = clock, trust, beginning
        self._model: dict[str, Any] | None = None  # a testbed's section; None: as each request
        self.testbed = AnnouncedTestbed()
        self.shaping: dict[str, Any] = {}

    @property
    def joint_names(self) -> tuple[str, ...]:
        """The joints of the testbed; none before it is known."""
        return tuple(self.testbed.joint_names)

    def set_assumptions(self, changes: Mapping[str, Any]) -> str:
        """Set some of ASSUMPTIONS, all or none; return why not, or ""."""
        before = self.shaping
        why = self.set_shaping(str(changes[_SHAPING])) if _SHAPING in changes else ""
        if not why and _MODEL in changes:
            why = self.set_model(str(changes[_MODEL]))
        if why:
            self.shaping = before
        return why

    def set_model(self, text: str) -> str:
        """Let requests that name no model believe what was identified; return why not, or "".

        Args:
            text: of an identified.yaml; empty: believe the bench again.
        """
        if self._clock.running:
            return "the bench is running: pause it, then set the model that plans believe"
        if not text:
            self._model = None
            return ""
        try:
            section = model_of(load_yaml(text, "model"), "model")
            names = read_testbed(section, "model", self._trust).model().joint_names
        except BadInput as error:
            return str(error)
        here = self.joint_names
        if here and names != here:
            return f"model: is of {', '.join(names)}; on the bench are {', '.join(here)}"
        self._model = section
        return ""

    def set_shaping(self, text: str) -> str:
        """Let trajectories that are received be shaped; return why not, or "".

        Args:
            text: keys of input_shaping as YAML; empty: trajectories are flown as they are.
        """
        try:
            values = load_yaml(text, "shaping") or {}
            if not isinstance(values, dict):
                return "shaping: give keys of input_shaping, for example {shaper: zvd}"
            for key in _OF_THE_TRAJECTORY & {*values}:
                return f"shaping: {key}: the trajectory has it; remove it"
            validated(InputShaping, values, "shaping", self._trust)
        except BadInput as error:
            return str(error)
        self.shaping = values
        return ""

    def request(
        self, section: str | dict[str, Any], period: float = 0.0, limit: Sequence[float] = ()
    ) -> PlanRequest | Refusal:
        """Return a client's request, from YAML or plain data.

        Period and limits may be left out, once a testbed is known.
        """
        here = self.testbed
        if not here.settings and not (period and limit):
            return NO_TESTBED
        found = plan_request(
            section, here.settings, period or here.period, limit or here.effort_limit,
            self._beginning, self._trust,
        )  # fmt: skip
        if isinstance(found, Refusal):
            return found
        values = found.values
        if self._model is not None and isinstance(values, dict) and not values.get("model"):
            values = values | {"model": self._model}
        return found._replace(values=values)

    def parameter_request(self, text: str) -> PlanRequest | Refusal:
        """Return what the node's own parameters ask for; they may name any method."""
        request = self.request(text)
        if isinstance(request, Refusal) or not isinstance(request.values, dict):
            return request
        method = str(request.values.get("method", ""))
        trust = Trust(self._trust.names | {method}, self._trust.trust_all)
        return request._replace(trust=trust)

    def next_start(self) -> float:
        """Return the earliest start of a plan that is requested now [s].

        The state of the bench may be received before its testbed: nothing can be planned then.
        """
        now, period = self._clock.now(), float(self.testbed.period)
        if now <= 0.0 or period <= 0.0:
            return 0.0
        return period * ceil((now + self._clock.later(START_MARGIN)) / period)
