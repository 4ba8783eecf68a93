"""The simulated four-axis gimbal against particles, conservation laws, and linearisation by differences.

The particles share no code with the simulation: rotations are scipy's, the inertia is that of point masses,
and torques follow from d'Alembert's principle, sum of m x'' . dx/dq.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy import signal
from scipy.spatial.transform import Rotation

from gsid.base.errors import InputError
from gsid.rig.gimbal import AXES, Gimbal, by_axis

SEED = 20261123
AXIS_OF_JOINT = ("x", "y", "z", "y")  # roll, outer elevation, inner azimuth, inner elevation
FREE = Gimbal(viscous_nm_s=(0,) * 4, stiffness_nm=(0,) * 4)


def orientation(angles, body):
    """Rotation from the frame of a body to that of the base."""
    turned = Rotation.identity()
    for axis, angle in zip(AXIS_OF_JOINT[: body + 1], angles, strict=False):
        turned = turned * Rotation.from_euler(axis, angle)
    return turned


def particles(inertia):
    """Six points of mass 1/2 with this tensor of inertia: their second moments are tr(I)/2 - I."""
    xx, yy, zz, xy, xz, yz = inertia
    tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    size, direction = np.linalg.eigh(np.trace(tensor) / 2 * np.eye(3) - tensor)
    arms = (np.sqrt(size) * direction).T
    return np.concatenate([arms, -arms])


def positions(angles):
    """All particles of the gimbal, (24, 3)."""
    bodies = enumerate(FREE.inertia_kg_m2)
    return np.concatenate([orientation(angles, b).apply(particles(inertia)) for b, inertia in bodies])


def motions(n):
    rng = np.random.default_rng(SEED)
    return [rng.uniform(-1.2, 1.2, (3, 4)) * np.array([[1.0], [3.0], [10.0]]) for _ in range(n)]


def second_difference(x, h):
    """x'' at 0 to order h^6."""
    weights = {0: -49 / 18, 1: 3 / 2, 2: -3 / 20, 3: 1 / 90}
    return sum(w * (x(k * h) + x(-k * h)) / (1 if k else 2) for k, w in weights.items()) / h**2


def first_difference(x, h):
    """x' at 0 to order h^6."""
    return sum(w * (x(k * h) - x(-k * h)) for k, w in {1: 3 / 4, 2: -3 / 20, 3: 1 / 60}.items()) / h


@pytest.mark.parametrize(("angle", "rate", "torque"), motions(5))
def test_the_motion_is_that_of_particles(angle, rate, torque):
    found = FREE.acceleration(angle, rate, torque)
    x = second_difference(lambda t: positions(angle + rate * t + found * t**2 / 2), 4e-3)
    by_angle = [first_difference(lambda t, e=e: positions(angle + e * t), 4e-3) for e in np.eye(4)]
    needed = [0.5 * np.sum(x * one) for one in by_angle]
    np.testing.assert_allclose(needed, torque, atol=1e-6)  # rounding 1e-16/h^2 and h^6 of the differences


@pytest.mark.parametrize(("angle", "rate", "_"), motions(3))
def test_a_gyro_measures_the_inertial_rate_of_its_body_about_its_joint(angle, rate, _):
    seen = FREE.gyros(angle) @ rate
    h = 1e-3
    for body, axis in enumerate(AXIS_OF_JOINT):
        at = [orientation(angle + k * h * rate, body) for k in (-1, 1)]
        turn = (at[0].inv() * at[1]).as_rotvec() / (2 * h)
        assert seen[body] == pytest.approx(turn["xyz".index(axis)], abs=2e-4)  # differences of order h^2


def test_energy_and_the_momentum_about_the_fixed_axis_are_conserved():
    """Without torques. Roll does not enter the inertia, so that its momentum is constant (Noether)."""
    plant = replace(FREE, fs_hz=2000.0)
    angle, rate = np.radians([10.0, -30, 20, 15]), np.array([0.5, -1.0, 2.0, 3.0])

    def conserved():
        mass = plant.mass_matrix(angle)
        return rate @ mass @ rate / 2, (mass @ rate)[0]

    before = conserved()
    start = angle.copy()
    for _ in range(1000):
        angle, rate = plant._step(angle, rate, np.zeros(4))
    assert np.all(np.abs(angle - start) > 0.05)  # it moved
    np.testing.assert_allclose(conserved(), before, rtol=1e-9)  # Runge-Kutta of order 4 at 0.5 ms


def test_the_linear_response_is_that_of_differences_of_the_equations():
    plant, f_hz, h = Gimbal(), np.array([0.7, 4.0, 30.0, 180.0]), 1e-5
    rest = np.concatenate([np.radians(plant.angle_deg), np.zeros(4)])

    def change(x, u):
        return np.concatenate([x[4:], plant.acceleration(x[:4], x[4:], u)])

    none = np.zeros(4)
    a = np.array([(change(rest + h * e, none) - change(rest - h * e, none)) / (2 * h) for e in np.eye(8)]).T
    b = np.array([(change(rest, h * e) - change(rest, -h * e)) / (2 * h) for e in np.eye(4)]).T
    c = np.hstack([np.zeros((4, 4)), np.degrees(plant.gyros(rest[:4]))])
    held = signal.cont2discrete((a, b, c, np.zeros((4, 4))), 1 / plant.fs_hz)
    z = np.exp(2j * np.pi * f_hz / plant.fs_hz)
    expected = [held[2] @ np.linalg.solve(w * np.eye(8) - held[0], held[1]) for w in z]
    np.testing.assert_allclose(plant.linear_response(f_hz), expected, rtol=1e-6)


def test_a_small_step_of_torque_moves_the_axes_as_the_linear_equations():
    """The samples themselves: torque held over each tick, output at the instant from which it is applied."""
    plant, n = Gimbal(fs_hz=250.0), 150
    u = np.zeros((n, 4))
    u[3:, 2] = 1e-5
    y, _ = plant.simulate(u)
    inverse = np.linalg.inv(plant.mass_matrix(np.radians(plant.angle_deg)))
    a = np.block(
        [[np.zeros((4, 4)), np.eye(4)], [-inverse * plant.stiffness_nm, -inverse * plant.viscous_nm_s]]
    )
    b = np.vstack([np.zeros((4, 4)), inverse])
    c = np.hstack([np.zeros((4, 4)), np.degrees(plant.gyros(np.radians(plant.angle_deg)))])
    held = signal.cont2discrete((a, b, c, np.zeros((4, 4))), 1 / plant.fs_hz)
    _, expected, _ = signal.dlsim(held, u)
    np.testing.assert_allclose(y, expected, atol=2e-4 * np.abs(expected).max())  # Runge-Kutta, h^5 a tick


def test_the_response_at_zero_frequency_is_refused():
    """Roll has no spring."""
    with pytest.raises(ValueError, match="above 0"):
        Gimbal().linear_response([0.0, 1.0])


def test_at_zero_angles_the_couplings_are_those_of_parallel_axes():
    """Both elevations are parallel then; azimuth and roll are at right angles to all others."""
    plain = [(xx, yy, zz, 0, 0, 0) for xx, yy, zz, *_ in Gimbal().inertia_kg_m2]
    mass = Gimbal(inertia_kg_m2=plain).mass_matrix(np.zeros(4))
    expected = np.diag([1.34, 0.50, 0.11, 0.04])
    expected[1, 3] = expected[3, 1] = 0.04
    np.testing.assert_allclose(mass, expected, atol=1e-15)
    gyros = np.eye(4)
    gyros[3, 1] = 1.0  # the gyro of the inner elevation turns with the outer one
    np.testing.assert_allclose(Gimbal().gyros(np.zeros(4)), gyros, atol=1e-15)


def test_several_experiments_at_once_are_those_one_by_one():
    u = np.random.default_rng(SEED).standard_normal((3, 20, 4)) * 0.1
    together, _ = Gimbal().simulate(u)
    np.testing.assert_allclose(together, [Gimbal().simulate(one)[0] for one in u], rtol=1e-12)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"viscous_nm_s": (1, 2, 3)}, "viscous_nm_s must be 4 finite numbers"),
        ({"friction_nm": (0, 0, -1, 0)}, "friction_nm must not be negative"),
        ({"fs_hz": 0.0}, "fs_hz must be a positive number"),
        ({"inertia_kg_m2": [(1, 1, 1, 2, 0, 0)] * 4}, "positive definite"),
        ({"angle_deg": (0, 0, np.nan, 0)}, "angle_deg must be 4 finite numbers"),
    ],
)
def test_impossible_values_are_named(wrong, message):
    with pytest.raises(ValueError, match=message):
        Gimbal(**wrong)


def test_torques_beyond_the_integration_are_refused():
    with pytest.raises(InputError, match="diverges"):
        Gimbal().simulate(np.full((2000, 4), 1e9))


def test_an_unknown_axis_is_named():
    assert by_axis({"roll": 2.0}, (0,) * 4) == (2.0, 0, 0, 0)
    with pytest.raises(ValueError, match="no axis inner_azimut"):
        by_axis({"inner_azimut": 1.0}, (0,) * 4)
    assert AXES[2] == "inner_azimuth"
