"""An emergency is everybody's: which benches `brake --all` finds."""

import threading
from collections.abc import Callable, Iterator
from typing import Any

import pytest
import rclpy
from flexslew_msgs import srv
from rclpy.executors import SingleThreadedExecutor

from flexslew_lab.run.domain import locked_domain
from flexslew_plant.ros.start import start_ros

pytestmark = pytest.mark.ros


def answer(request: Any, reply: Any) -> Any:
    reply.ok, reply.message = True, f"{request.action} granted"
    return reply


@pytest.fixture
def _two_benches(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Two plants of one domain, each in a namespace, that no run has claimed."""
    context = rclpy.Context()
    with locked_domain() as domain:
        monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
        start_ros(context=context)
        executor = SingleThreadedExecutor(context=context)
        for name in ("bench1", "bench2"):
            plant = rclpy.create_node("plant", namespace=name, context=context)
            plant.create_service(srv.Operate, "operate", answer)
            executor.add_node(plant)
        serving = threading.Thread(target=executor.spin, daemon=True)
        serving.start()
        yield
        executor.shutdown()
        serving.join()
        context.try_shutdown()


@pytest.mark.usefixtures("_two_benches")
def test_every_bench_is_braked_in_whatever_namespace(
    monkeypatch: pytest.MonkeyPatch, call: Callable[..., tuple[Any, str]]
) -> None:
    for patience in ("ros.operator._OTHERS", "cli.operate._FALLBACK_TIMEOUT"):
        monkeypatch.setattr(f"flexslew_lab.{patience}", 5.0)  # of a busy machine
    monkeypatch.setattr("flexslew_lab.cli.operate.running_benches", list)
    monkeypatch.setattr("flexslew_lab.run.domain.running_benches", lambda all_users=False: [])
    code, words = call("brake", "--all")
    assert code == 0
    assert {line.rpartition(" ")[2] for line in words.splitlines()} == {"/bench1)", "/bench2)"}
    code, words = call("brake", "--all", "--namespace", "bench1")
    assert (code, len(words.splitlines())) == (0, 1)
    monkeypatch.setattr("flexslew_lab.cli.operate._FALLBACK_TIMEOUT", 5.0)
    code, words = call("brake")
    assert code != 0
    assert "--namespace bench1, bench2" in words
