"""Model predictive control: the prediction as one quadratic program, and the law that flies it."""
