"""Python steps carried out on the numbers of a C program, which so writes itself.

Offers: controller_tick, evaluator, numpy_functions, operations, phases, printer, program, values.
"""
