"""Controllers of a given structure, tuned against goals over an ensemble of models.

Offers: page, tuned, tuning_file.
"""
