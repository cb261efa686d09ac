"""The numbers of a curve of a page."""

from base64 import b64decode

import numpy as np


def numbers(encoded: dict[str, str]) -> np.ndarray:
    """Return the numbers that a panel holds for plotly.js."""
    return np.frombuffer(b64decode(encoded["bdata"]), dtype=encoded["dtype"])
