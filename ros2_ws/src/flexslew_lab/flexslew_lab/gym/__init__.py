"""Benchmark tasks as environments of Gymnasium: one on the bench, many in a batch."""
