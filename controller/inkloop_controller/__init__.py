"""The layer controller of inkloop: prediction model, layer problem, estimator, baselines."""
