"""Mutation testing of the safety path: each change of a module must be noticed by its checks.

`python -m tests.mutation` plays all mutants of all modules in `subjects.py`. `test_share.py` plays a share of them.
"""
