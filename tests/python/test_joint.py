"""The twist of a joint with play, driven by a torque that is known, against closed forms."""

import numpy as np

from gsid.joint_motion import twist_of

GAP, STIFFNESS, DAMPING = 0.01, 1e5, 40.0


def twist(torque, n, h, gap=GAP):
    lanes = [np.array([value]) for value in (gap, STIFFNESS, DAMPING)]
    return twist_of(torque[None], *lanes, h)[0]


def test_without_play_the_twist_is_that_of_spring_and_damper():
    n, cycles, h = 3000, 40, 1e-4
    phase = 2 * np.pi * cycles * np.arange(n) / n
    got = twist(500 * np.cos(phase), n, h, gap=0.0)
    omega = 2 * np.pi * cycles / (n * h)
    wanted = np.real(500 * np.exp(1j * phase) / (STIFFNESS + 1j * omega * DAMPING))
    # The trapezoidal rule turns omega into 2 / h tan(omega h / 2): (omega h)^2 / 12 = 6e-4 of it.
    np.testing.assert_allclose(got, wanted, atol=1e-3 * np.abs(wanted).max())


def test_a_slow_torque_twists_the_joint_by_half_its_play_more():
    n, h = 20000, 1e-3
    torque = 500 * np.sin(2 * np.pi * np.arange(n) / n)
    got = twist(torque, n, h)
    pressed = np.abs(torque) > 250
    wanted = torque / STIFFNESS + np.sign(torque) * GAP / 2
    # Late by damping / stiffness = 0.4 ms of 20 s.
    np.testing.assert_allclose(got[pressed], wanted[pressed], atol=1e-3 * GAP)


def test_within_the_play_only_the_damping_holds():
    n, h = 1000, 1e-4
    torque = 40 * np.sin(2 * np.pi * np.arange(n) / n)
    got = twist(torque, n, h, gap=1.0)  # never reached: 40 / 40 deg/s for 0.05 s
    slope = np.gradient(got, h)[1:-1]
    np.testing.assert_allclose(slope, torque[1:-1] / DAMPING, atol=1e-4)
