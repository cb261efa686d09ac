"""Matrices that depend on parameters in a box, as polynomials and linear fractional forms."""
