"""Where compiled code keeps the numbers for which the processor has no registers left."""

from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

from flexslew_plant.machine_code.cache_names import set_intrinsic_cache_name

_LINE = 64  # bytes in a line of the cache, and in the widest vector


@set_intrinsic_cache_name
@intrinsic  # type: ignore[untyped-decorator]
def aligned_frame(typing: Any) -> Any:
    """Let the caller's place for them begin a line of the cache: a vector across two costs twice.

    The compiler aligns it where an instruction in the function requires it: here a line that is
    held by an instruction which does nothing.
    """

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        line = cgutils.alloca_once(builder, ir.ArrayType(ir.DoubleType(), _LINE // 8))
        line.align = _LINE
        builder.asm(ir.FunctionType(ir.VoidType(), [line.type]), "", "r", [line], side_effect=True)
        return context.get_dummy_value()

    return types.none(), generate
