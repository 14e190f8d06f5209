"""Discrepancy: find where simulation and measured runs disagree, which effect is missing, and the model that includes it.

runs --run_checks.py--> floor (fitting/noise.py) --fitting/evidence.py--> whitened residuals of a model (fitting/model.py)
re-fit the baseline (fitting/fit.py) --> where: atlas.py; which effect: fit every candidate (candidates.py)
decide (decision.py) --> add the effect and repeat (search.py) --> Result (result.py) --> report, model file, pictures
"""
