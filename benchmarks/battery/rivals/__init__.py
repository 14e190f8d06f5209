"""Other methods on the same cases: same runs, noise floors, re-fitted baseline and names of effects.

Two need `pip install -e '.[battery]'`: pysindy and scikit-learn.
"""

METHODS = ("gaussian_process", "sindy", "classifier")  # the first prepares data for the others
