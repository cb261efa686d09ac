"""Modes of a record by maximum likelihood: from poles by subspaces to residues by least squares."""
