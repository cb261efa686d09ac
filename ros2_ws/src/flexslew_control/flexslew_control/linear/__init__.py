"""Linear models of a plant and the tools of linear designs: small motions, holds, Riccati.

Offers: design_checks, free_platform, held_step, perturbation, rate_dependent_platform, riccati,
small_motion, zero_order_hold.
"""
