"""Metrics, figures, reports and comparisons of runs.

Offers: page, panels, report, run_data, runs_index, scene_data, signals, sky_map, tables,
handover_lines, verdict.
"""
