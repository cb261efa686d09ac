"""A stack on whole lines of the cache, for loops with more vectors than there are registers.

The compiler keeps what does not fit into registers on the stack, which begins anywhere unless it
was asked for an aligned object before: each of those vectors then lies across two lines.
"""

from typing import Any

from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic

_LINE = 64  # bytes


@intrinsic
def aligned_stack(_: Any) -> Any:
    """Align the stack of the function that calls this one."""

    def generate(context: Any, builder: Any, *_: Any) -> Any:
        with builder.goto_entry_block():
            place = builder.alloca(ir.DoubleType())
            place.align = _LINE
        takes = ir.FunctionType(ir.VoidType(), [place.type])
        builder.asm(takes, "", "r", [place], side_effect=True)  # nothing: but the object is needed
        return context.get_dummy_value()

    return types.void(), generate
