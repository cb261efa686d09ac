"""Worst case over a box of uncertain parameters: a certificate, and the loop that breaks it.

`model` is the uncertain plant and loop, `fit` replaces them by polynomials and fractions, `cells`
and `scalings` are the two ways to certify these.

Offers: bounds, flight, model.parameters, model.situation, model.uncertain_model, tables,
worst_case.
"""
