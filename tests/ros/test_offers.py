"""What a node offers, when a client is quicker than discovery."""

import warnings
from types import SimpleNamespace
from typing import Any

import pytest

from flexslew_plant.ros.offers import service


@pytest.mark.parametrize(("lost", "sent", "told"), [(0, 1, 0), (1, 2, 0), (4, 5, 0), (99, 10, 1)])
def test_an_answer_to_a_client_that_was_not_discovered_yet_is_sent_again(
    lost: int, sent: int, told: int
) -> None:
    sendings: list[Any] = []

    def send(response: Any, header: Any) -> None:
        sendings.append((response, header))
        if len(sendings) <= lost:
            warnings.warn("failed to send response (timeout)", RuntimeWarning, stacklevel=1)

    made, offered = SimpleNamespace(send_response=send), list[Any]()

    def create(kind: Any, name: str, answer: Any) -> Any:
        offered.append(answer)
        return made

    node: Any = SimpleNamespace(create_service=create)
    service(node, None, "step", lambda request, response: response)
    with warnings.catch_warnings(record=True) as shown:
        warnings.simplefilter("always")
        made.send_response(offered[0](None, "done"), 7)  # as an executor does
    assert sendings == [("done", 7)] * sent
    assert len(shown) == told
