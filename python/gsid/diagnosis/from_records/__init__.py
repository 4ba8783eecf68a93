"""Diagnosis from the records alone: linear structure, missing torque, confirmation by simulation.

`diagnose_records` (diagnose.py) runs the steps. canonical.py makes the stack on which laws are judged,
draft.py repeats the first stage until its best law is not a linear one, confirm.py fits the best laws by
simulation, and verdict.py decides whether a law is confirmed. The constants stand in settings.py.
"""
