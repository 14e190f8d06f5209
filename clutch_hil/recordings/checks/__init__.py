"""Checks of a recording before anything is fitted to it: one list (every_check.py), for import, discrepancy and identification.

A check looks at columns of numbers and at what is known of them (knowledge.py). It knows no rig and no model: predictions of a
baseline come in as plain arrays. What it sees is a Finding (finding.py), hard or soft.
"""
