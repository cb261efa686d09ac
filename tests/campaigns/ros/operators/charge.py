"""Who is in charge: switches, the brake, nodes that die and come back."""

from typing import Any

from flexslew_msgs import srv
from rclpy.task import Future

from flexslew_plant.bench.operation.run_state import RUNNING
from flexslew_plant.graph import topics
from flexslew_plant.ros.messages import stamp

from .bench import PLANNER_NODE
from .desk import WHO, Acts, Desk

HASTY = 0.5  # of those who are started again: before the graph has let go of their predecessor
SLOW = 3.0  # at most: who is ready answers in time on a busy machine, too
WAIT = 1.0  # for a switch [wall s]


class Charge:
    """Acts on who is in charge."""

    def __init__(self, desk: Desk) -> None:
        self._desk, self._bench = desk, desk.bench
        self._awaited: list[Future] = []
        self.acts: Acts = {
            self.switch: 5.0, self.switches_at_once: 2.0, self.switch_later: 1.0,
            self.brake: 1.0, self.release: 1.5, self.brakes_at_once: 1.5,
            self.kill: 2.0, self.kill_planner: 0.7, self.start_again: 3.0,
        }  # fmt: skip

    def switch(self) -> str:
        """Who is ready takes over, unless something comes between."""
        desk, here = self._desk, self._bench.controllers
        name, strict = desk.pick([*here, *here, "nobody"]), desk.chance(0.3)
        active, ready = self._bench.ready()
        state = self._bench.state
        calm = state.state == RUNNING and 0.0 < state.rate_factor <= SLOW and not state.faults
        must = calm and name in ready - {active} and not (strict or desk.braked)
        reply = self._switched(name, strict=strict, max_effort_step=desk.pick([0.0, 1.0, 100.0]))
        assert reply.ok or not must, (reply, desk.diary)
        return desk.worded(reply.ok, f"{name}: {reply.message}")

    def _switched(self, name: str, **more: Any) -> Any:
        service = topics.SWITCH_CONTROLLER
        fields = {"controller": name, "timeout": WAIT, "who": WHO, **more}
        return self._desk.ask(srv.SwitchController, service, **fields)

    def switches_at_once(self) -> str:
        """Two operators ask for one controller each: nobody is left without an answer."""
        names = self._desk.case.permutation(self._bench.controllers).tolist()
        service = topics.SWITCH_CONTROLLER
        one, other = self._bench.both(
            srv.SwitchController, service, *({"controller": n, "timeout": WAIT} for n in names[:2])
        )
        assert all((one.message, other.message)), (one, other, self._desk.diary)
        return f"{one.message}; {other.message}"

    def switch_later(self) -> str:
        """The second operator waits for what becomes of a switch, as long as it takes."""
        name = self._desk.pick(self._bench.controllers)
        at = float(self._bench.state.tick) * 0.01 + self._desk.pick([0.5, 5.0])
        asked = {"controller": name, "at": stamp(at), "who": "bob"}
        service = topics.SWITCH_CONTROLLER
        self._awaited.append(self._bench.second.begin(srv.SwitchController, service, **asked))
        return f"{name} at {at:g} s"

    def responses(self) -> str:
        """Nobody is left waiting for a switch."""
        for asked in self._awaited:
            self._bench.second.until(asked.done, lambda: self._desk.diary)
        return "; ".join(asked.result().message for asked in self._awaited)

    def take_charge(self) -> str:
        """Where the brake acts, and all are ready, anybody can be switched in."""
        if self._bench.ready()[0]:
            return "somebody is"
        reply = self._switched(self._desk.pick(self._bench.controllers), timeout=0.0)
        return self._desk.granted(reply.ok, reply.message, True)

    def brake(self) -> str:
        """It is latched once."""
        words = self._desk.operate(topics.BRAKE, not self._desk.braked)
        self._desk.braked = True
        return words

    def brake_surely(self) -> str:
        """It is latched from the next tick on, whether it was to be or not."""
        return "it is latched" if self._desk.braked else self.brake()

    def relieve(self) -> str:
        """Who is ready takes over from one who cannot go on; without anybody the brake does."""
        active, ready = self._bench.ready()
        others = sorted(ready - {active} - self._bench.dead)
        if not others or self._desk.braked:
            return self.brake_surely()
        name = self._desk.pick(others)
        reply = self._switched(name)
        return self._desk.worded(reply.ok, f"{name}: {reply.message}")

    def bring_back(self) -> str:
        """Who is in charge and dead is started again; who lives is relieved by the brake."""
        active = self._bench.state.active
        if active not in self._bench.dead:
            return self.brake_surely()
        if PLANNER_NODE in self._bench.dead:  # whose plan it needs
            self._bench.start_again(PLANNER_NODE)
        self._bench.start_again(active)
        return str(active)

    def release(self) -> str:
        """It is released once."""
        words = self._desk.operate(topics.RELEASE_BRAKE, self._desk.braked)
        self._desk.braked = False
        return words

    def brakes_at_once(self) -> str:
        """Two operators ask for the same: one of them has done it."""
        action = topics.RELEASE_BRAKE if self._desk.braked else topics.BRAKE
        asked = {"action": action, "who": "bob"}
        one, other = self._bench.both(srv.Operate, topics.OPERATE, asked, asked)
        assert one.ok != other.ok, (one, other, self._desk.diary)
        self._desk.braked = not self._desk.braked
        return f"{one.message}; {other.message}"

    def kill(self) -> str:
        """A controller dies, whoever it is."""
        alive = self._bench.alive
        return self._killed(self._desk.pick(alive)) if alive else "all are dead"

    def kill_planner(self) -> str:
        """The planner dies."""
        return "dead" if PLANNER_NODE in self._bench.dead else self._killed(PLANNER_NODE)

    def _killed(self, name: str) -> str:
        self._bench.kill(name)
        if self._desk.chance(HASTY):
            self._bench.start_again(name)
            return f"{name}, started again at once"
        self._bench.let_go()
        return name

    def start_again(self) -> str:
        """Who died comes back."""
        if not self._bench.dead:
            return "all live"
        name = self._desk.pick(sorted(self._bench.dead))
        self._bench.start_again(name)
        return name
