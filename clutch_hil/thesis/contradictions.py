"""Claims of the thesis that do not hold here, each with the reason."""

CONTRADICTED = {
    "figure-3.6": "misprints: both printed transfer functions contradict the printed system equations",
    "figure-3.10": "a model in one direction has no tilting modes: two resonances below 500 Hz at own weight, not more",
    "figure-3.11": "over the dynamometer torque, which is the friction, sliding is a damper: -22 dB/decade, not -40",
    "figure-4.6": "eq 4.1 scales the viscous part with F_s too: one shape of the curve, one speed of its minimum at all loads",
    "figure-4.15": "eq 4.1 has one a_1 for all loads, and the simulator's lift-up takes more of a high "
    "load: depth falls with load",
    "figure-4.16": "the level 0.1148 to 0.113 is that of Table 6.3; Table 6.4, which the plant follows, gives 0.086 to 0.082",
    "figure-4.18": "the simulator's film lifts by the speed alone, as much at every load: the butterfly "
    "is not clearest at the lowest",
    "figure-4.13": "the simulator's lift-up is the same at every load, so speed shows at 280 N as much as at higher loads",
    "figure-6.8": "the axis of the figure contradicts eq 6.3 with Table 6.1, which the plant follows",
    "figure-6.9": "with gamma = 1/3 the viscous term is 18 % of the torque at 10 rpm, so temperature shows there",
    "table-6.3": "contradicts Tables 6.4 and 6.5 at 200 rpm, which the plant follows, by 6 % in slope",
    "elements": "on a smooth curve without noise 10 elements err five times less than 4; on a measured contact they do not",
    "figure-D.4": "even error needs distances inverse to the root of the second derivative",
}
