"""Studies: one trial flown thousands of times with varied values, and what that shows.

Offers: cases, execution.cluster, execution.pace, execution.worker, findings.criteria,
findings.page, findings.summary, findings.tables, finish, flight, identity_file, batch.check,
batch.fleet, merge, run, store, study, study_settings, variants, varied.
"""
