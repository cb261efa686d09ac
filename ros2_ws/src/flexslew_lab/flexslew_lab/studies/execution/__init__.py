"""The executors of the trials of a study: processes here, or the workers of a cluster."""
