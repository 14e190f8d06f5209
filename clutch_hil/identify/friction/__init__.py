"""Identify friction: from position, speed, force and load of any rig to a friction law, with its intervals.

slide_record.py: what is read. law.py: the five laws and their parameters. motion_model.py: the force that a rig with such a law
shows. selection.py: which terms held-out stretches ask for. intervals.py: 95 % intervals. excitation.py: what the runs cannot
say. identification.py: all of it in turn. result.py: the TOML file. lift_up.py: the lift-up force from butterflies.
"""
