"""Rank the laws of the catalogue by the missing torque that they explain, without any simulation.

`first_stage` (stage.py) fits the linear part of a plant to the records (linear_fit.py), takes the motion from
the measured output (motion.py), refers every law's torque along that motion to the output (law_columns.py),
ranks the laws by what they explain beside the linear part (ranking.py) and decides whether the best one
meets the conditions of a name (conclusion.py). The constants stand in settings.py.
"""
