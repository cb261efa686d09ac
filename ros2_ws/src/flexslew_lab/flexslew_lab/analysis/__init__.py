"""What a trial flies, as a control engineer asks: its models, margins and how they are proved.

Offers: analysis, page, proof, proof_tables, trial_models.
"""
