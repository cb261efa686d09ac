"""Metrics, figures, reports and comparisons of runs.

Offers: page, panels, report, run_data, run_notes, runs_index, runs_server, scene_data, sections,
signals, sky_map, handover_lines, verdict.
"""
