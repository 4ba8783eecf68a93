"""Exported C, compiled, against what the desktop says of the same model."""

import ctypes
import os
import shlex
import subprocess

import numpy as np
import pytest

from gsid import InputError
from gsid.models.export_c import export_c
from gsid.models.rational import RationalModel
from gsid.plant.model import PlantModel

FS_HZ, N = 3000, 600
FLAGS = (
    "-std=c99 -pedantic -Wall -Wextra -Wconversion -Wdouble-promotion -Werror -ffp-contract=off -fPIC -shared"
)
RIG = {"num": [9.4, 3, 1.1e6], "den": np.polymul([1, 11], [1, 24, 1.6e5])}


@pytest.fixture
def compiled(tmp_path):
    """Export and compile a model; give its step over a signal, and its feed-forward of rate and angle."""

    def compiled(model, **options):
        made = export_c(model, "rig", **options)
        (tmp_path / "rig.h").write_text(made.header)
        (tmp_path / "rig.c").write_text(made.source)
        compiler = shlex.split(os.environ.get("CC", "cc"))
        library = tmp_path / f"rig{len(list(tmp_path.iterdir()))}.so"  # one name would be loaded once
        subprocess.run(
            [*compiler, *FLAGS.split(), "-O2", "-fPIC", "-shared", "-o", library, "rig.c", "-lm"],
            cwd=tmp_path,
            check=True,
        )
        library = ctypes.CDLL(str(library))
        library.rig_step.restype = ctypes.c_float
        library.rig_step.argtypes = [ctypes.c_void_p, ctypes.c_float]
        state = ctypes.create_string_buffer(4096)
        library.rig_reset(state)

        def feedforward(rate, angle):
            library.rig_feedforward.restype = ctypes.c_float
            return library.rig_feedforward(ctypes.c_float(rate), ctypes.c_float(angle))

        return (lambda u: np.array([library.rig_step(state, one) for one in u])), feedforward

    return compiled


def lines_of(step, n_periods, fs_hz=FS_HZ):
    """Response at lines 1 .. 50 by a multisine, in the period after n_periods."""
    phase = np.random.default_rng(5).uniform(0, 2 * np.pi, 50)
    k = np.arange(1, 51)
    u = np.cos(2 * np.pi * np.outer(np.arange(N), k) / N + phase).sum(axis=1).astype(np.float32)
    y = step(np.tile(u, n_periods + 1))[-N:]
    return k * fs_hz / N, (np.fft.rfft(y) / np.fft.rfft(u.astype(float)))[k]


@pytest.mark.parametrize("delay_s", [0, 0.0051, 3 / FS_HZ])
@pytest.mark.parametrize("num", [RIG["num"], [0.1, *RIG["num"]]])
def test_a_held_model_answers_as_on_the_desktop(compiled, num, delay_s):
    model = RationalModel(num, RIG["den"], delay_s, fs_hz=FS_HZ, hold="zoh")
    step, _ = compiled(model)
    f, g = lines_of(step, 15)  # 3 s: poles of 11 rad/s leave 1e-14
    # Single precision: 6e-8 a step, over the slowest pole's 270 steps, of the largest line.
    np.testing.assert_allclose(g, model.response(f), rtol=0, atol=2e-5 * np.abs(g).max())


def test_a_model_in_z_answers_as_on_the_desktop(compiled):
    model = RationalModel([0.2, 0.1], [1, -1.6, 0.7], 4 / FS_HZ, domain="z", fs_hz=FS_HZ)
    f, g = lines_of(compiled(model)[0], 3)
    np.testing.assert_allclose(g, model.response(f), rtol=0, atol=1e-6 * np.abs(g).max())


def test_the_half_sample_of_a_hold_is_subtracted(compiled):
    model = RationalModel(**RIG, delay_s=0.0051, fs_hz=FS_HZ)
    f, g = lines_of(compiled(model)[0], 15)
    ratio = g / model.response(f)
    # What is left of the hold is its sinc, and the images that it folds back: (f/fs)^2 of the line at most.
    np.testing.assert_allclose(ratio, np.sinc(f / FS_HZ), atol=2e-2)
    np.testing.assert_allclose(np.angle(ratio), 0, atol=2e-2)


@pytest.mark.parametrize(("fs_hz", "hold"), [(1000, "none"), (1000, "zoh"), (7500, "none")])
def test_the_requested_rate_is_that_of_the_step(compiled, fs_hz, hold):
    """Bug: --fs was taken and ignored, for every model has a rate; the code was for that one, in silence."""
    model = RationalModel(**RIG, delay_s=0.0051, fs_hz=FS_HZ, hold=hold)
    assert export_c(model, "rig", fs_hz=fs_hz).fs_hz == fs_hz
    f, g = lines_of(compiled(model, fs_hz=fs_hz)[0], 60, fs_hz)
    behind = 0.5 / FS_HZ if hold == "none" else 0  # the half sample is that of the rate it was measured at
    want = RationalModel(**RIG, delay_s=model.delay_s - behind, fs_hz=fs_hz, hold="zoh").response(f)
    np.testing.assert_allclose(g, want, rtol=0, atol=2e-5 * np.abs(want).max())


def test_a_plant_is_exported_at_the_requested_rate(compiled):
    model = plant(*LINEAR)
    u = (5 * np.sin(2 * np.pi * 3 * np.arange(N) / N)).astype(np.float32)
    y = compiled(model, fs_hz=1000)[0](np.tile(u, 20))[-N:]
    model.fs_hz = 1000
    want = model.simulate(u.astype(float)).y
    np.testing.assert_allclose(y, want, rtol=0, atol=3e-5 * np.abs(want).max())


def test_a_model_in_z_has_no_other_rate():
    model = RationalModel([0.2, 0.1], [1, -1.6, 0.7], domain="z", fs_hz=FS_HZ)
    assert export_c(model, fs_hz=FS_HZ).fs_hz == FS_HZ
    with pytest.raises(InputError, match="valid at its own rate only") as refused:
        export_c(model, fs_hz=1000)
    assert "--domain s" in refused.value.hint


def plant(*more):
    effects = [("rigid_body", {"gain": 7.4}), ("viscous_friction", {"rate": 11}), *more]
    return PlantModel.from_dict(
        {
            "gsid_model": 1,
            "fs_hz": FS_HZ,
            "effects": [{"effect": effect, "params": params} for effect, params in effects],
        }
    )


LINEAR = [
    ("cable_spring", {"stiffness": 170}),
    ("transport_delay", {"delay_s": 0.0051}),
    ("motor_lag", {"time_constant_s": 0.002}),
    ("flexible_mode", {"f_hz": 60, "zeta": 0.03, "residue": 0.3}),
    ("sensor_lag", {"time_constant_s": 0.001}),
]


@pytest.mark.parametrize("output", ["rate", "angle"])
@pytest.mark.parametrize(
    "maps", [[], [("drive_dead_zone", {"half_width": 0.5}), ("drive_saturation", {"limit": 4})]]
)
def test_a_linear_plant_answers_as_on_the_desktop(compiled, output, maps):
    model = plant(*maps, *LINEAR)
    model.output = output
    step, _ = compiled(model)
    u = (5 * np.sin(2 * np.pi * 3 * np.arange(N) / N)).astype(np.float32)
    y = step(np.tile(u, 20))[-N:]
    want = model.simulate(u.astype(float)).y
    np.testing.assert_allclose(y, want, rtol=0, atol=3e-5 * np.abs(want).max())


@pytest.mark.parametrize(
    "second",
    [
        ("flexible_mode", {"f_hz": 25, "zeta": 0.05, "residue": -0.2}),
        ("motor_lag", {"time_constant_s": 0.01}),
        ("sensor_lag", {"time_constant_s": 0.01}),
        ("transport_delay", {"delay_s": 0.02}),
        ("viscous_friction", {"rate": 20}),
        ("cable_spring", {"stiffness": 500}),
    ],
    ids=lambda second: second[0],
)
def test_two_effects_of_one_id_are_both_exported(compiled, second):
    """Bug: of two effects of one id the last alone was in the step."""
    model = plant(*LINEAR, second)
    u = (5 * np.sin(2 * np.pi * 3 * np.arange(N) / N)).astype(np.float32)
    y = compiled(model)[0](np.tile(u, 20))[-N:]
    want = model.simulate(u.astype(float)).y
    np.testing.assert_allclose(y, want, rtol=0, atol=3e-5 * np.abs(want).max())


def test_the_feedforward_takes_the_friction_away(compiled):
    """With it the whole plant follows the step; without it friction takes a good part of the motion."""
    friction = [
        ("stribeck_friction", {"level": 15, "extra": 5, "velocity": 0.3}),
        ("quadratic_drag", {"rate": 0.5}),
    ]
    model = plant(*friction)
    step, feedforward = compiled(model)
    u = (8 * np.sin(2 * np.pi * 3 * np.arange(N) / N)).astype(np.float32)
    wanted = step(np.tile(u, 20))[-N:]
    help_ = np.array([feedforward(rate, 0) for rate in wanted])
    error = model.simulate(u + help_).y - wanted
    print(f"left of friction: {np.std(error) / np.std(wanted):.2g} of the motion")
    alone = model.simulate(u.astype(float)).y - wanted
    # The sign of the rate turns within a sample, and the law is held over it: some samples' worth in 200.
    assert np.std(error) < 0.02 * np.std(wanted)
    assert np.std(alone) > 0.2 * np.std(wanted)


@pytest.mark.parametrize(
    ("model", "what"),
    [
        (RationalModel([1], [1, -2], fs_hz=FS_HZ, hold="zoh"), "not stable"),
        (RationalModel([1, 0, 0], [1, 2], 1, fs_hz=FS_HZ, hold="zoh"), "more zeros than poles"),
        (RationalModel([1], [1, 2], 0, fs_hz=FS_HZ), "delay after the hold is negative"),
        (RationalModel([1], [1, 2]), "does not state the rate"),
        (RationalModel([1], [1, -0.5], 1.4 / FS_HZ, domain="z", fs_hz=FS_HZ), "whole samples"),
        (plant(("hard_stop", {"angle_deg": 1, "stiffness": 1e5})), "cannot be exported as C"),
    ],
)
def test_what_cannot_be_exported_is_refused(model, what):
    with pytest.raises(InputError, match=what) as refused:
        export_c(model, where="rig.json")
    assert refused.value.hint


def test_a_cpp_program_links_it(tmp_path):
    """Bug: the header did not say extern "C"."""
    made = export_c(RationalModel(**RIG, delay_s=0.0051, fs_hz=FS_HZ, hold="zoh"), "rig")
    (tmp_path / "rig.h").write_text(made.header)
    (tmp_path / "rig.c").write_text(made.source)
    user = '#include "rig.h"\nint main() { rig m; rig_reset(&m); return rig_step(&m, 0) != 0; }\n'
    (tmp_path / "user.cpp").write_text(user)
    compiler = shlex.split(os.environ.get("CC", "cc"))
    subprocess.run([*compiler, "-std=c99", "-c", "rig.c"], cwd=tmp_path, check=True)
    cxx = shlex.split(os.environ.get("CXX", "c++"))
    subprocess.run(
        [*cxx, "-Wall", "-Werror", "-o", "user", "user.cpp", "rig.o", "-lm"], cwd=tmp_path, check=True
    )
    assert subprocess.run([tmp_path / "user"]).returncode == 0


def test_an_invalid_name():
    with pytest.raises(ValueError, match="C identifier"):
        export_c(RationalModel([1], [1, 2], 0.1, fs_hz=FS_HZ), "2fast")


def drive(**effects):
    stack = [
        {"effect": "rigid_body", "params": {"gain": 7.4}},
        {"effect": "viscous_friction", "params": {"rate": 3}},
    ]
    stack += [{"effect": f"drive_{name}", "params": params} for name, params in effects.items()]
    return PlantModel.from_dict({"gsid_model": 1, "fs_hz": FS_HZ, "effects": stack})


@pytest.mark.parametrize("effect", [{"saturation": {"limit": 0}}, {"quantization": {"step": 0}}])
def test_a_drive_without_a_limit_or_step_passes_the_command(compiled, effect):
    """Bug: a limit of 0, which is none, was exported as a clip to 0; a step of 0 as a division by it."""
    u = np.array([1, -2, 3.7, 0], np.float32)
    as_it_is = compiled(drive())[0](u)
    np.testing.assert_array_equal(compiled(drive(**effect))[0](u), as_it_is)


def test_halves_of_a_step_are_rounded_as_on_the_desktop(compiled):
    """Bug: -1 with steps of 2 was rounded to 0, on the desktop and in the core to -2."""
    commands = np.array([1, -1, 3, -3, 0, 5, -5], np.float32)
    rounded = np.array([2, -2, 4, -4, 0, 6, -6], np.float32)
    exact = compiled(drive())[0](rounded)
    np.testing.assert_array_equal(compiled(drive(quantization={"step": 2}))[0](commands), exact)
    periodic = np.repeat(commands, 10).astype(float)
    on_desktop = drive(quantization={"step": 2}).simulate(periodic)
    without_steps = drive().simulate(np.repeat(rounded, 10).astype(float))
    np.testing.assert_allclose(on_desktop.Y, without_steps.Y, atol=1e-12)
