"""Discrepancy: where a simulation and measured runs disagree, which physical effect is missing, and the model with it added.

runs --runs.py--> floor (noise.py) --evidence.py--> whitened residuals of a model (model.py)
baseline re-fitted (fit.py) --> where: atlas.py; what: every candidate fitted (candidates.py)
decision (decision.py) --> added, and again (search.py) --> Result (result.py) --> report, model file, pictures
"""
