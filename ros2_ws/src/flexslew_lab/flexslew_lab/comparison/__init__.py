"""The same manoeuvre by every planner, or by every law, side by side on one page.

Offers: laws, laws_page, planners, planners_page.
"""
