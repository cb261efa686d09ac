"""Metrics, figures, reports and comparisons of runs.

Offers: page, panels, report, run_data, runs_index, scene_data, sections, signals, sky_map,
handover_lines, verdict.
"""
