"""Diagnosis from the records alone: linear structure, missing torque, confirmation by simulation.

`diagnose_records` (diagnose.py) runs the steps on the state of a diagnosis (run.py): the linear structure
(find_structure.py), the first draft (draw_up.py), the fits by simulation (fit_laws.py), the structure beside
the law (mend_structure.py), its values with equal weights (equal_weights.py), and further effects of a given
model (rounds.py). canonical.py makes the stack on which laws are judged, draft.py repeats the first stage
until its best law is not a linear one, confirm.py fits a law by simulation, evidence.py compares the fits,
and verdict.py decides whether a law is confirmed. The limits of the decision stand in settings.py, those of a
single step at the top of its module.
"""
