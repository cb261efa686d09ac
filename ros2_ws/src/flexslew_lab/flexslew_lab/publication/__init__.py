"""What a paper takes from runs: figures, tables of metrics, animations and an archive.

Offers: animation, archive, channels, figure, metric_table.
"""
