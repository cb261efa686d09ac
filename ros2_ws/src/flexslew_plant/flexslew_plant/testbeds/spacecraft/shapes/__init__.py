"""Flexible shapes: beams, membranes and modal data, as sums over their mass points."""
