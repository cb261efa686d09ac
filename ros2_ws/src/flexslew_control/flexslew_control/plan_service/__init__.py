"""Plans for clients while a bench runs: requests, the job that plans, drafts and releases.

Offers: job, planning, release, requests.
"""
