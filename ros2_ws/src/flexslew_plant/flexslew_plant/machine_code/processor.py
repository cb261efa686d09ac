"""How the compiler writes for this processor."""

import numba
from llvmlite.binding import set_option
from numba.core import codegen


def configure_compiler() -> None:
    """Set the compiler's options, before it compiles anything.

    Loops that are written out cost a sixth of its time, and no kernel is faster for them. Where
    vectors of 512 bits are to be had, LLVM takes half of one on most processors, as older ones slow
    down for whole ones; and two vectors at a time hide how long an operation takes. Both change
    how many members are computed at once, but no bits; the two save a third of the time.
    """
    options = ["--unroll-threshold=0", "--unroll-partial-threshold=0"]
    features = codegen.get_host_cpu_features()
    user_options = numba.config.CPU_NAME is not None or numba.config.CPU_FEATURES is not None
    if "+avx512f" in features.split(",") and not user_options:  # the user's choice is the user's
        numba.config.CPU_FEATURES = features + ",-prefer-256-bit"
        options.append("--force-vector-interleave=2")
    for option in options:
        set_option("flexslew", option)
