"""A rig at the end of a serial line, real or simulated."""

ABSENT_S = 3.0  # an attended run is stopped after this time without a sign of life
