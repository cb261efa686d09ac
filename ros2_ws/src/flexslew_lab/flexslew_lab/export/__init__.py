"""What flies, written out for other programs: C code.

Offers: c_module, compiled, flight_vector, fmu.binaries, fmu.of_trial, folder, plant_module,
targets.
"""
