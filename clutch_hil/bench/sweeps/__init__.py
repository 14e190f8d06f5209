"""Many runs: samples of parameters, executors and tables of results."""
