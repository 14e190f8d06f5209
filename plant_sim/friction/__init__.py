"""Friction from asperities to control; docs/friction.md compares the models and shows how they are used.

For control: `coulomb`, `dahl`, `lugre`, `elasto_plastic`, `leuven`, `maxwell_slip`, `gms`, `xgms`, `passive_xgms`, `lift_up`,
`directed` (another law each way), `shaped` (asymmetric loops).
From physics: `generic` (asperities), `rayleigh_step` and `step_bearing` (oil film), `generic_rayleigh` (both).
`kernel` has the signature that all laws share, `model` what all models offer, `coupled` the balance with a structure,
`identification` their parameters from measurements.
"""
