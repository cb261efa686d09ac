"""What a trial flies, in a control engineer's terms: its models, margins and their proof.

Offers: analysis, mode_flight, page, proof, proof_tables, separation, trial_models.
"""
