"""The same manoeuvre by every planner, or by every law, side by side on one page."""
