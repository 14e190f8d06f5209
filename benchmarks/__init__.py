"""Measurements that are not tests."""

import protocols  # noqa: F401  # sets the number of BLAS threads before numpy is imported, as for the command
