"""The control engineer's side of the bench: models out, margins of what flies, designs in.

Import it where it is used: its modules load python-control, which takes more than a second.

Offers: linear_plant, loop, loop_margins, lti, minimal, model_file, modes, nonlinear_plant,
numeric_state, rest, rigid_motions, ring_down, save_law, signals.
"""
