"""Fitting: common core of identification and discrepancy. It fits a rig's model by simulation error, with intervals.

model.py: interface of a rig's model. evidence.py: residuals of runs and a model in multiples of the noise floor (noise.py).
fit.py: damped Gauss-Newton within bounds, with or without prior. intervals.py: 95 % intervals, robust to correlated residuals.
"""
