"""Studies: one trial flown thousands of times with varied values, and what that shows.

Offers: batch.batch_metrics, batch.check, batch.fleet, batch.legs, batch.recorded, batch.stepped,
batch.stepped_loop, batch.tolerance, cases, execution.cluster, execution.pace, execution.worker,
findings.criteria, findings.page, findings.summary, findings.tables, finish, flight, identity,
identity_file, merge, run, sampling.methods, seals, store, study, study_settings, variants, varied,
ways.
"""
