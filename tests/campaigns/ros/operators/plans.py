"""Plans, and what is bent, pushed and turned meanwhile."""

from json import dumps  # which is YAML, in one line
from typing import Any

from flexslew_msgs import srv

from flexslew_plant.bench.operation.run_state import RUNNING
from flexslew_plant.graph import topics
from flexslew_plant.ros.messages import stamp

from .bench import PLANNER_NODE
from .desk import WHO, Acts, Desk

WILD = 0.15  # of all requests
WRONG: list[dict[str, Any]] = [{"goal": {"elbow": 1.0}}, {"start": 0.0}, {"duration": 0.05}]


class Plans:
    """Acts that change where the bench goes."""

    def __init__(self, desk: Desk) -> None:
        self._desk, self._bench = desk, desk.bench
        self.acts: Acts = {
            self.plan: 5.0, self.draft: 2.0, self.cancel: 0.3,
            self.inject: 2.0, self.end_fault: 1.0, self.retarget: 3.0 * bool(desk.habits.turns),
        }  # fmt: skip

    def plan(self) -> str:
        """It is flown, or refused in words; it is never cancelled."""
        if PLANNER_NODE in self._bench.dead:
            return "nobody plans"
        request = self._request(self._desk.chance(WILD))
        result = self._bench.plan(topics.PLAN_SLEW, request)
        assert result.error_code != result.CANCELED, self._desk.diary
        assert bool(result.plan.hash) or result.error_code, self._desk.diary
        assert result.message, self._desk.diary
        return f"{request}: {result.error_code} {result.message}"

    def draft(self) -> str:
        """It is kept, then adopted or refused."""
        if PLANNER_NODE in self._bench.dead:
            return "nobody plans"
        request = self._request()
        result = self._bench.plan(topics.DRAFT_PLAN, request)
        if result.error_code:
            return self._desk.worded(False, f"{request}: {result.error_code} {result.message}")
        action = f"{self._desk.pick(['adopt', 'refuse'])} {result.plan.hash}"
        reply = self._desk.ask(srv.Operate, topics.DECIDE_PLAN, action=action, who=WHO)
        assert reply.message, self._desk.diary
        return f"{request}: {action} {reply.ok} {reply.message}"

    def cancel(self) -> str:
        """It ends at once, if it has not ended before."""
        if PLANNER_NODE in self._bench.dead:
            return "nobody plans"
        result = self._bench.plan(topics.PLAN_SLEW, self._request(), cancel=True)
        assert result.message, self._desk.diary
        return f"{result.error_code} {result.message}"

    def _request(self, wild: bool = False) -> str:
        case, most = self._desk.case, self._desk.habits.goals
        method = "reference_only" if self._desk.chance(0.7) else "optimized_feedforward"
        goal = {name: round(float(case.uniform(-end, end)), 3) for name, end in most.items()}
        values: dict[str, Any] = {"method": method, "goal": goal, "duration": 15.0, "functions": 20}
        if method == "reference_only":
            del values["functions"]
        values["start"] = self._later()
        if wild:
            values |= self._desk.pick(WRONG)
        return dumps(values)

    def _later(self) -> float:
        """Return a simulated time that will hardly have come before a plan is made [s]."""
        state, soon = self._bench.state, self._desk.pick([5.0, 15.0])
        rate = state.rate_factor if state.state == RUNNING else 0.01
        return round(float(state.tick) * 0.01 + soon * max(float(rate), 0.01), 2)

    def inject(self) -> str:
        """It breaks, or is refused in words."""
        until = self._bench.state.tick * 0.01 + float(self._desk.case.uniform(6.0, 20.0))
        text = dumps({**self._desk.pick(self._desk.habits.faults), "until": until})
        reply = self._desk.ask(srv.InjectFault, topics.INJECT_FAULT, fault=text, who=WHO)
        return self._desk.granted(reply.ok, reply.message, True)

    def end_fault(self) -> str:
        """What breaks is whole again, what does not is refused in words."""
        number = self._desk.pick([*self._bench.state.fault_numbers, 4711])
        reply = self._desk.ask(srv.EndFault, topics.END_FAULT, number=number, who=WHO)
        return self._desk.worded(reply.ok, reply.message)

    def end_all(self) -> None:
        """Nothing is broken any more."""
        for number in self._bench.state.fault_numbers:
            self._desk.ask(srv.EndFault, topics.END_FAULT, number=number, who=WHO)

    def retarget(self) -> str:
        """The appendage turns, or it is refused in words."""
        turn = dumps(self._desk.pick(self._desk.habits.turns))
        at = stamp(self._desk.pick([0.0, self._bench.state.tick * 0.01 + 5.0]))
        reply = self._desk.ask(srv.Retarget, topics.RETARGET, target=turn, at=at, who=WHO)
        return f"{turn}: {reply.ok} {self._desk.worded(reply.ok, reply.message)}"
