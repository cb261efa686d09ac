"""One manoeuvre by every planner, or by every law, side by side: presets of one comparison.

Offers: comparison, laws, page, planners, winners.
"""
