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

    made = SimpleNamespace(send_response=send)
    node: Any = SimpleNamespace(create_service=lambda *given: made)
    service(node, None, "step", lambda request, response: response)
    with warnings.catch_warnings(record=True) as shown:
        warnings.simplefilter("always")
        made.send_response("done", 7)
    assert sendings == [("done", 7)] * sent
    assert len(shown) == told
