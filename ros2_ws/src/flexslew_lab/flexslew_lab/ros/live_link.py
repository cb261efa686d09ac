"""The way from a page to a bench that runs."""

from collections import deque
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import partial
from time import monotonic
from typing import Any

import numpy as np
from flexslew_msgs import action
from rclpy.node import Node

from flexslew_lab.console.link import Iterate, PlanCallback, RequestResult, Then
from flexslew_lab.console.view import EVENTS, BenchView
from flexslew_lab.log.messages import cdr
from flexslew_lab.ros.bench_client import BenchClient
from flexslew_lab.ros.hidden_listener import HiddenListener
from flexslew_lab.ros.rebroadcast import PASSED_ON
from flexslew_plant.errors import BadInput
from flexslew_plant.graph import topics
from flexslew_plant.graph.topics import TOPICS
from flexslew_plant.own_code import NO_CODE, Trust

_TOPICS = (
    topics.TESTBED, topics.BENCH_STATE, topics.CONTROLLER_STATUS, topics.EVENTS, topics.PLAN,
    topics.RECORDED,
)  # fmt: skip
_STORED_TOPICS = (topics.EVENTS, topics.PLAN)  # may arrive before their testbed
_RECORDER_TIMEOUT = 4.0  # until ticks are taken without the recorder; DDS needs up to 3 [wall s]
# delays after the announcement of another plant; a controller that is then not on the graph is of
# the bench before: a node leaves the graph at once, a killed one after 20 s [wall s]
_SORTED_OUT = (3.0, 25.0)
_PLANT_TIMEOUT = (
    5.0  # after which the plant is taken for gone; it shows its state twice a second [wall s]
)


class LiveLink:
    """A console.link.Link over the topics, the services and the action of a bench.

    Args:
        node: of this process.
        folder: of the run; empty: not known.
        command: that repeats the run.
        trust: which testbeds of the user's own may be loaded, to be drawn.
    """

    replay = False

    def __init__(self, node: Node, folder: str, command: str, trust: Trust = NO_CODE) -> None:
        self.view, self.folder, self.command = BenchView(trust), folder, command
        self._client = BenchClient(node)
        self._last_received = 0.0  # of the plant, last [wall s]
        self._recorded = monotonic()  # when the recorder last sent, or could not [wall s]
        self._listener = HiddenListener(node, {name: TOPICS[name] for name in _TOPICS})
        self._sort_out: tuple[float, ...] = ()  # when to check which controllers remain [wall s]
        self._buffer: deque[tuple[int, str, bytes]] = deque(maxlen=EVENTS)  # when [ns], topic, CDR
        self._count_truth_publishers = partial(
            node.count_publishers, node.resolve_topic_name(topics.TRUTH)
        )

    def poll(self, now: float) -> None:
        """Take what has come, and deliver answers."""
        batches: dict[str, list[bytes]] = {}
        testbed_time = 0  # when a testbed was [ns]
        for name, data, info in self._listener.take():
            if name in _STORED_TOPICS:
                self._buffer.append((info["source_timestamp"], name, data))
            elif name == topics.TESTBED:
                testbed_time = info["source_timestamp"]
            if name != topics.RECORDED:
                batches.setdefault(name, []).append(data)
                continue
            with suppress(BadInput):
                topic, messages = _unpack(data)
                batches.setdefault(topic, []).extend(messages)
        if testbed_time and self.view.joints is not None:  # by another plant
            self.view.clear()
            for name in _STORED_TOPICS:
                batches[name] = [
                    d for at, of, d in self._buffer if of == name and at >= testbed_time
                ]
            self._sort_out = tuple(now + later for later in _SORTED_OUT)
        for name, batch in batches.items():
            with suppress(BadInput):  # no message ends a page
                self.view.take(name, TOPICS[name].type, batch)
        if topics.RECORDED in self._listener.subscriptions:
            self._miss_recorder(now, topics.TRUTH in batches)
        if topics.BENCH_STATE in batches:
            self._last_received = now
        elif now - self._last_received > _PLANT_TIMEOUT and self.view.now.state in (
            "running",
            "paused",
        ):
            self.view.now = self.view.now._replace(state="silent: no sign of life of the plant")
        if self._sort_out and now >= self._sort_out[0]:
            self._sort_out = self._sort_out[1:]
            node_names = {*self._listener.node.get_node_names()}
            for name in self.view.controllers.keys() - node_names:
                del self.view.controllers[name]
        self._client.poll(now)

    def _miss_recorder(self, now: float, passed_on: bool) -> None:
        """Listen to the ticks themselves where no recorder passes them on.

        Where a bag is played there are ticks, and no state of a bench.
        """
        state = self.view.now.state
        ticks = state == "running" or (state == "not found" and self._count_truth_publishers() > 0)
        if passed_on or not ticks:
            self._recorded = now
        elif now - self._recorded > _RECORDER_TIMEOUT:
            self._listener.ignore(topics.RECORDED)
            for name in PASSED_ON:
                self._listener.listen(name, TOPICS[name])

    def ask(self, service: str, values: Mapping[str, Any], then: Then) -> None:
        """Call a service of the bench."""
        self._client.ask(service, values, then)

    def draft(
        self, request: str, who: str, progress: Callable[[Iterate], None], then: PlanCallback
    ) -> None:
        """Request from the planner a manoeuvre that no controller follows yet."""
        joints = self.view.joints
        if joints is None:
            then(RequestResult(False, "no testbed has announced itself yet"), None)
            return
        goal = action.PlanSlew.Goal(
            request=request, period=joints.period, effort_limit=list(joints.limit), who=who
        )
        self._client.plan(topics.DRAFT_PLAN, goal, progress, then)

    def cancel(self) -> None:
        """Give up the plan that is being made."""
        self._client.cancel()

    def measure(self, on: bool) -> None:
        """Subscribe to the sensors at every tick, or unsubscribe."""
        name = topics.MEASUREMENT
        if on and name not in self._listener.subscriptions:
            self._listener.listen(name, TOPICS[name])
        elif not on and name in self._listener.subscriptions:
            self._listener.ignore(name)

    def close(self) -> None:
        """Leave the graph."""
        self._listener.close()
        self._client.close()


def _unpack(data: bytes) -> tuple[str, list[bytes]]:
    """Return the name of a topic and its messages.

    Raises:
        BadInput: it is none that a recorder passes on.
    """
    batch = cdr.decode(TOPICS[topics.RECORDED].type, data)
    if batch.topic.removeprefix("/") not in PASSED_ON:
        raise BadInput(f"{batch.topic} is not passed on", topics.RECORDED)
    ends = np.cumsum(batch.sizes).tolist()
    whole = batch.data.tobytes()
    return batch.topic.removeprefix("/"), [
        whole[start:end] for start, end in zip([0, *ends], ends, strict=False)
    ]
