"""Exported models compiled for Cortex-M7: identical to the bit to the same C on a computer."""

from __future__ import annotations

import subprocess

import numpy as np
import pytest
from emulator import BOARDS, ROOT

from gsid.models.export_c import export_c
from gsid.models.rational import RationalModel
from gsid.plant.model import PlantModel

FS_HZ = 3000
C = [
    "-std=c99",
    "-Wall",
    "-Wextra",
    "-Wdouble-promotion",
    "-Werror",
    "-O2",
    "-ffp-contract=off",
    "-DGSID_SINGLE",
]
M7 = ["-mcpu=cortex-m7", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv5-sp-d16", "-fno-math-errno", "-DON_BOARD"]
LINK = [
    "-nostartfiles",
    "--specs=nano.specs",
    "-Wl,--gc-sections",
    "-T",
    ROOT / "firmware_examples/cortex_m7/mps2.ld",
]
MODE = np.polymul([1, 11], [1, 24, 1.6e5])
MODELS = {
    "held": RationalModel([9.4, 3, 1.1e6], MODE, 0.0051, fs_hz=FS_HZ, hold="zoh"),
    "z": RationalModel([0.2, 0.1], [1, -1.6, 0.7], 4 / FS_HZ, domain="z", fs_hz=FS_HZ),
    "plant": PlantModel.from_dict(
        {
            "gsid_model": 1,
            "fs_hz": FS_HZ,
            "effects": [
                {"effect": "rigid_body", "params": {"gain": 7.4}},
                {"effect": "viscous_friction", "params": {"rate": 11}},
                {"effect": "coulomb_friction", "params": {"level": 5}},
                {"effect": "quadratic_drag", "params": {"rate": 0.1}},
                {"effect": "flexible_mode", "params": {"f_hz": 60, "zeta": 0.03, "residue": 0.3}},
                {"effect": "transport_delay", "params": {"delay_s": 0.0051}},
            ],
        }
    ),
}


def run(*words) -> subprocess.CompletedProcess:
    return subprocess.run([str(word) for word in words], check=True, capture_output=True, text=True)


def numbers(text: str) -> np.ndarray:
    return np.array([int(word, 16) for word in text.split()], np.uint32).view(np.float32)


@pytest.mark.parametrize("name", MODELS)
def test_target_and_computer_give_the_same_bits(tmp_path, name):
    made = export_c(MODELS[name], "exported")
    (tmp_path / "exported.h").write_text(made.header)
    (tmp_path / "exported.c").write_text(made.source)
    sources = [ROOT / "firmware_examples/tests/exported_main.c", tmp_path / "exported.c"]
    flags = [*C, "-I", tmp_path, "-I", ROOT / "include"]
    flags += ["-DEXPORTED_HAS_FEEDFORWARD"] if made.feedforward else []
    board = [ROOT / f"firmware_examples/cortex_m7/{file}.c" for file in ("board", "startup")]
    run("arm-none-eabi-gcc", *M7, *flags, *LINK, "-o", tmp_path / "m7.elf", *board, *sources, "-lm")
    run("cc", *flags, "-o", tmp_path / "host", *sources, "-lm")

    emulator = [
        "qemu-system-arm",
        "-M",
        BOARDS["m7"],
        "-display",
        "none",
        "-monitor",
        "none",
        "-serial",
        "null",
    ]
    semihosting = ["-semihosting-config", "enable=on,target=native"]
    target = numbers(run(*emulator, *semihosting, "-kernel", tmp_path / "m7.elf").stderr)
    host = numbers(run(tmp_path / "host").stdout)
    assert len(host) == 600 * (2 if made.feedforward else 1)
    assert np.abs(host).max() > 0
    assert (target.view(np.uint32) == host.view(np.uint32)).all()
