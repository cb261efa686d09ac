"""Finite element models as shapes: mass and stiffness matrices, reduced to the clamped modes.

`readers` makes a model of a file, `boundary` the clamped degrees of freedom, `reduction` the modes
and what they do to the interface, `checks` what is wrong with them, `modal_content` modal data.
"""
