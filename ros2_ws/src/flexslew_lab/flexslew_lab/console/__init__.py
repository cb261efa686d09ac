"""The console: a page in the browser over a bench that runs, or over the log of a run."""
