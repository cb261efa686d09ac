"""Services of a plant that flies, and of one that leaves."""

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest
from flexslew_msgs.srv import InjectFault, Note
from std_srvs.srv import Trigger

from flexslew_plant.ros.plant import requests


def answer(_: Any, reply: Any) -> Any:
    reply.message = "done"
    setattr(reply, "success" if isinstance(reply, Trigger.Response) else "ok", True)
    return reply


async def later(request: Any, reply: Any) -> Any:
    return answer(request, reply)


def at_last(found: Any) -> Any:
    """Return what a coroutine that waits for nobody returns, or what is no coroutine."""
    if not hasattr(found, "send"):
        return found
    with pytest.raises(StopIteration) as end:
        found.send(None)
    return end.value.value


@pytest.mark.parametrize("kind", [Trigger, Note, InjectFault])
@pytest.mark.parametrize("given", [answer, later])
def test_a_plant_that_leaves_grants_nothing(
    kind: Any, given: Callable[[Any, Any], Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    offered: list[Any] = []
    monkeypatch.setattr(requests, "service", lambda node, kind, name, act: offered.append(act))
    loop: Any = SimpleNamespace(is_closing=False)
    node: Any = None
    requests.add_service(node, loop, kind, "name", given)
    (act,) = offered
    granted = at_last(act(kind.Request(), kind.Response()))
    assert granted.message == "done"
    loop.is_closing = True
    refused = at_last(act(kind.Request(), kind.Response()))
    assert refused.message == "the run is over"
    assert not getattr(refused, "success", False)
    assert not getattr(refused, "ok", False)
    assert getattr(refused, "number", -1) == -1
