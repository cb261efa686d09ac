"""The console: a page in the browser over a bench that runs, or over the log of a run.

Offers: in_process.link, link, live_gate, page, picture, replay_page, view.
"""
