"""Ids of the effects that a linear axis consists of, and of those that the diagnosis treats on their own."""

BODY, DAMPING, SPRING = "rigid_body", "viscous_friction", "cable_spring"
MODE, DELAY = "flexible_mode", "transport_delay"
LAGS = ("sensor_lag", "motor_lag")  # the data do not distinguish them; the first lag is given to the sensor
BIAS, CUBIC, STOP = "torque_bias", "cubic_spring", "hard_stop"
COGGING, UNBALANCE = "motor_cogging", "mass_unbalance"
