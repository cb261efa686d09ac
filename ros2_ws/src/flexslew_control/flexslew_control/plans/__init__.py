"""Plans as files and as courses: the plan of a tick, the motion before it, how closely it is kept.

Offers: course, known_motion, plan_file, planned_course, tracking.
"""
