"""The messages of every tick have the bytes that the middleware reads and writes."""

import numpy as np
import pytest
from rclpy.serialization import deserialize_message, serialize_message

from flexslew_lab.log.messages.cdr import decode, encode
from flexslew_plant.ros.offers import message_class
from tests.plant.test_message_codec import FLAT, assert_equal, drawn


@pytest.mark.parametrize("kind", FLAT)
def test_bytes_are_those_of_the_middleware(kind: str) -> None:
    rng = np.random.default_rng(3)
    for _ in range(20):
        message = drawn(kind, rng)
        data = encode(kind, message)
        again = serialize_message(deserialize_message(data, message_class(kind)))
        assert_equal(message, decode(kind, bytes(again)[: len(data)]))  # without padding at the end
