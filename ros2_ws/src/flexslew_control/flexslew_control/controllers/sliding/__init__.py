"""Output feedback control: a sliding hypersurface from an LQ problem."""
