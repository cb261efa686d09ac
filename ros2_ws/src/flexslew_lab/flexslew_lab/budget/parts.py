"""The words that a budget is made with; the command line reads them without loading NumPy."""

from typing import Literal, TypeAlias, get_args

Interpretation: TypeAlias = Literal["mixed", "temporal", "ensemble"]
INTERPRETATIONS: tuple[Interpretation, ...] = get_args(Interpretation)
