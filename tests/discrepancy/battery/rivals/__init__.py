"""Other methods on the same cases: same runs, noise floors and re-fitted baseline, and the catalogue's names to answer with.

They need `pip install -e '.[battery]'`: pysindy and scikit-learn.
"""

METHODS = ("gaussian_process", "sindy", "classifier")  # the first one needs most, and leaves the others what they need

# two operating points each: the limits that do best, and those that do best among them that keep the workflow's goal
MOST_NAMED = {"best": 1.0, "cautious": 0.05}  # share of the development split's unknown effects that may be named
