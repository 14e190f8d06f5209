"""Other methods on the same cases: same runs, noise floors and re-fitted baseline, and the catalogue's names to answer with.

Two need `pip install -e '.[battery]'`: pysindy and scikit-learn.
"""

METHODS = ("gaussian_process", "sindy", "classifier")  # the first one needs most, and leaves the others what they need
