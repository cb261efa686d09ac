"""C code of a controller or a testbed as a functional mock-up unit, FMI 2.0 and 3.0.

Offers: archive.
"""
