"""Equations of motion of a packed spacecraft, as compiled kernels."""
