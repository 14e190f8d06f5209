"""Discrepancy: where a simulation and measured runs disagree, which physical effect is missing, and the model with it added.

runs --run_checks.py--> floor (fitting/noise.py) --fitting/evidence.py--> whitened residuals of a model (fitting/model.py)
baseline re-fitted (fitting/fit.py) --> where: atlas.py; what: every candidate fitted (candidates.py)
decision (decision.py) --> added, and again (search.py) --> Result (result.py) --> report, model file, pictures
"""
