"""Fitting: one core for identification and discrepancy. Parameters of a rig's model by simulation error, with their intervals.

model.py: what a rig's model is. evidence.py: runs and a model as residuals in multiples of the noise floor (noise.py).
fit.py: damped Gauss-Newton within bounds, with or without prior. intervals.py: 95 % intervals, robust to correlated residuals.
"""
