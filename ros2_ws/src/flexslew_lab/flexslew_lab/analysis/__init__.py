"""What a trial flies, in a control engineer's terms: its models, margins and their proof.

Offers: analysis, page, proof, proof_tables, trial_models.
"""
