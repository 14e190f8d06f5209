"""Friction from asperities to control.

| module | model | memory | Stribeck | lag | load | for |
|---|---|---|---|---|---|---|
| `coulomb` | static curve | - | yes | - | - | gross sliding |
| `dahl` | one smooth hysteresis | local | - | - | - | pre-sliding |
| `lugre` | bristle | local | yes | yes | - | sliding; drifts under a steady load |
| `elasto_plastic` | bristle that does not creep | local | yes | yes | - | pre-sliding and sliding |
| `leuven` | bristle with Maxwell-slip hysteresis | non-local, creeps | yes | yes | - | the field's step before GMS |
| `maxwell_slip` | springs and sliders | non-local | - | - | - | pre-sliding |
| `gms` | Maxwell-slip with a sliding law | non-local | yes | yes | - | pre-sliding and sliding |
| `xgms` | GMS under a varying load | non-local | yes | yes | yes | control |
| `passive_xgms` | XGMS that never gives out energy | non-local | yes | yes | yes | co-simulation, proofs |
| `lift_up` | XGMS with a normal degree of freedom | non-local | yes | yes | yes | lubricated contacts |
| `generic` | asperities on a stepped surface | yes | yes | yes | yes | dry friction from its physics |
| `rayleigh_step`, `step_bearing` | step bearing on a film | - | yes | yes | yes | hydrodynamic friction |
| `generic_rayleigh` | asperities with Rayleigh steps | yes | yes | yes | yes | all lubrication regimes |

`kernel` has the signature that all laws share, `model` what all models offer, `coupled` the balance with a structure,
`identification` their parameters from measurements.
"""
