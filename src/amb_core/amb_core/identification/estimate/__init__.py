"""Estimation of a model from data: subspace methods, the prediction-error method, and the choice of the order."""
