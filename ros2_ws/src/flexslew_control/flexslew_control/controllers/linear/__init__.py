"""Any linear time-invariant controller, from python-control, MATLAB or a file."""
