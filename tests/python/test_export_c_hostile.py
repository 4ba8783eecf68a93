"""Exported C of hostile models and names: compiled as C99 and as C++, and run."""

import os
import re
import shlex
import subprocess
from pathlib import Path

import numpy as np
import pytest

from gsid import InputError
from gsid.base.c_text import KEYWORDS, comment, literal, refused_name
from gsid.models.export_c import export_c
from gsid.models.rational import RationalModel
from gsid.plant.model import PlantModel
from gsid.records.files import read_record, write_record
from gsid.records.record import Record

CC, CXX = (shlex.split(os.environ.get(key, default)) for key, default in (("CC", "cc"), ("CXX", "c++")))
STRICT = ["-pedantic", "-Wall", "-Wextra", "-Wcomment", "-Wtrigraphs", "-Werror"]
COMPILERS = {
    "c99": [*CC, "-std=c99", *STRICT],
    "c++": [*CXX, "-x", "c++", "-std=c++17", *STRICT],
}

RUNS = 'int injected(void); int injected(void) { return 1; }\n#error "this text is compiled"\n'
HOSTILE = {
    "end": f"deg */\n{RUNS}/*",
    "end_split_by_a_star": "**/" + RUNS + "/**",
    "end_behind_a_slash": "/*/" + RUNS + "/*/",
    "end_by_a_trigraph": "*??/\n/\n" + RUNS,
    "end_by_a_spliced_line": "*\\\n/\n" + RUNS,
    "end_by_a_carriage_return": "*\r/\r\n" + RUNS,
    "line_comment": "// " + RUNS,
    "nested": "/* /* */ */" + RUNS,
    "backslash_at_the_end": "deg\\",
    "trigraph_at_the_end": "deg??/",
    "all_trigraphs": "??= ??( ??/ ??) ??' ??< ??! ??> ??-",
    "control": "".join(map(chr, range(32))) + "\x7f\x1b[2J",
    "line_separators": "*\x85/\u2028*/\u2029\v*/\f" + RUNS,
    "not_ascii": "°/s · µA \u202e*/ \U0001f600 \ud800",
    "format": "%s%n%d {name} {0}",
    "long": "deg/s " * 10_000,
}


def compiled(made, folder, compiler, name="rig"):
    """Compile the pair of files; the compiler's words where it refuses."""
    (folder / f"{name}.h").write_text(made.header, encoding="ascii")
    (folder / f"{name}.c").write_text(made.source, encoding="ascii")
    command = [*COMPILERS[compiler], "-c", "-o", f"{name}.o", f"{name}.c"]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=60).stderr


def plant(**values):
    effects = [
        {"effect": "rigid_body", "params": {"gain": 7.4}},
        {"effect": "coulomb_friction", "params": {"level": 15}},
        {"effect": "mass_unbalance", "params": {"level": 15, "angle_deg": -20}},
        {"effect": "drive_saturation", "params": {"limit": 100}},
        {"effect": "flexible_mode", "params": {"f_hz": 179, "zeta": 0.015, "residue": 0.15}},
    ]
    return PlantModel.from_dict({"gsid_model": 1, "fs_hz": 3000, "effects": effects} | values)


@pytest.mark.parametrize("compiler", COMPILERS)
@pytest.mark.parametrize("case", HOSTILE)
def test_units_do_not_leave_their_comment(tmp_path, case, compiler):
    """Bug: a unit with */ was compiled, so that a model file or the header of a CSV file ran code."""
    text = HOSTILE[case]
    for model in (RationalModel([7.4], [1, 11], 0.0051, fs_hz=3000, hold="zoh"), plant()):
        model.u_unit = model.y_unit = text  # set late: a model refuses some of them when it is made
        made = export_c(model, "rig")
        assert compiled(made, tmp_path, compiler) == ""
        assert made.header.startswith("/* Made by gsid")
        assert made.header.splitlines()[0].endswith(" */")
        symbols = subprocess.run(["nm", "rig.o"], cwd=tmp_path, capture_output=True, text=True).stdout
        assert "injected" not in symbols


def test_a_unit_of_a_record_reaches_the_code_as_a_comment(tmp_path):
    text = "deg/s */ int injected; /*"
    write_record(tmp_path / "rec.csv", Record(np.arange(40.0), np.ones(40), 10.0, y_unit=text))
    assert read_record(tmp_path / "rec.csv").y_unit == text
    model = RationalModel([1], [1, 2], fs_hz=10, hold="zoh", y_unit=text)
    model.save(tmp_path / "m.json")
    made = export_c(RationalModel.load(tmp_path / "m.json"), "rig")
    assert "deg/s * / int injected; / *" in made.header
    assert compiled(made, tmp_path, "c99") == ""


def test_usual_units_are_as_they_were():
    for text in ("deg/s", "A", "N*m/(kg*m^2)", "command, 1/s", "%"):
        assert comment(text) == text


def test_any_text_is_a_comment():
    """Random texts of the characters that matter (seed 14)."""
    rng = np.random.default_rng(14)
    for _ in range(2000):
        text = comment("".join(rng.choice(list("*/\\?\n\r x<>='()!-é\0"), rng.integers(1, 40))))
        assert re.fullmatch(r"[ -~]*", text)
        assert not re.search(r"\*/|/\*|//|\\|\?\?", text)


NAMES = [
    "float", "class", "template", "and", "nullptr", "bool", "asm", "main", "memset", "strlen", "sinf",
    "expf", "y1", "jn", "gamma", "index", "linux", "NAN", "INFINITY", "NULL", "size_t", "isnan",
    "HUGE_VAL", "RAD_PER_DEG", "system", "std", "free", "random", "div", "math", "string", "Stdio",
    "_rig", "__rig", "_Rig", "rig__2", "2fast", "rig-2", "rig 2", "rig;", "größe", "x\n", "a\\\nb", "",
    "rig.c", "${x}", "rig\u0301",
]  # fmt: skip


@pytest.mark.parametrize("name", NAMES)
def test_a_name_that_c_or_c_plus_plus_uses_is_refused(name):
    """Bug: a model file float.json was exported as `typedef struct {...} float;`."""
    with pytest.raises(ValueError, match="is not a valid name in C"):
        export_c(plant(), name)


@pytest.mark.parametrize("standard", ["c99", "gnu17"])
def test_names_of_the_c_library_are_refused(tmp_path, standard):
    """What the headers that the source includes declare, as this compiler says."""
    (tmp_path / "all.c").write_text("#include <math.h>\n#include <string.h>\n")
    command = [*CC, f"-std={standard}", "-E", "all.c"]
    text = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True).stdout
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    declared = set(re.findall(r"(?<![\w.])([A-Za-z]\w*)\s*\(", "\n".join(lines)))
    declared |= set(re.findall(r"^typedef .*?(\w+);$", "\n".join(lines), re.M))
    macros = subprocess.run(
        [*command, "-dM"], cwd=tmp_path, capture_output=True, text=True, check=True
    ).stdout
    declared |= set(re.findall(r"^#define ([A-Za-z]\w*)", macros, re.M))
    plain = {name for name in declared if not name.startswith("_") and "__" not in name}
    assert sorted(name for name in plain if not refused_name(name)) == []


@pytest.mark.parametrize(
    "name",
    ["m", "u", "x", "y", "at", "late", "early", "next", "i", "rate", "angle", "torque", "rig2", "Rig_b"],
)
def test_names_of_its_own_variables_are_good_names(tmp_path, name):
    for compiler in COMPILERS:
        assert compiled(export_c(plant(), name), tmp_path, compiler, name) == ""


def test_keywords_are_those_that_the_compilers_refuse(tmp_path):
    """A variable of each name: C or C++ refuses it, or a later standard of C has it as a keyword."""
    later = {"typeof", "typeof_unqual"}
    for word in sorted(KEYWORDS - later):
        text = f"int f(void) {{ int {word} = 0; return {word}; }}\n"
        results = [
            subprocess.run(
                [*compiler, "-fsyntax-only", "-"], input=text, capture_output=True, text=True
            ).returncode
            for compiler in ([*CC, "-x", "c", "-std=c99"], [*CXX, "-x", "c++", "-std=c++20"])
        ]
        assert any(results), word


@pytest.mark.parametrize(
    "model",
    [
        RationalModel([1e39], [1, 11], fs_hz=3000, hold="zoh"),
        RationalModel([1e300, 1e300], [1, 11], fs_hz=3000, hold="zoh"),
        RationalModel([1e200], [1, 1e200, 1e308], fs_hz=3000, hold="zoh"),
        RationalModel([1e39], [1, -0.5], domain="z", fs_hz=3000),
    ],
)
def test_no_literal_is_infinite(model):
    """Bug: coefficients beyond single precision were written as inff, which no compiler knows."""
    with pytest.raises(InputError, match="cannot be exported"):
        export_c(model, "rig", where="rig.json")
    with pytest.raises(ValueError, match="single precision"):
        literal(float("nan"))


@pytest.mark.parametrize("fs_hz", [np.inf, np.nan, -1.0, 0.0])
def test_an_invalid_rate_is_refused(fs_hz):
    with pytest.raises(ValueError, match="fs_hz"):
        export_c(plant(), fs_hz=fs_hz)


@pytest.mark.parametrize(
    "model",
    [
        RationalModel([1], [1, 11], 1e6, fs_hz=3000, hold="zoh"),
        RationalModel([1], [1, 11], 1e300, fs_hz=3000, hold="zoh"),
        RationalModel([1], [1, -0.5], 1e6, domain="z", fs_hz=3000),
    ],
)
def test_a_delay_that_fills_the_memory_is_refused(model):
    with pytest.raises(InputError, match="the delay exceeds"):
        export_c(model)


def test_friction_without_a_gain_is_refused():
    """Bug: ZeroDivisionError."""
    effects = [
        {"effect": "rigid_body", "params": {"gain": 0}},
        {"effect": "torque_bias", "params": {"level": 1}},
    ]
    model = PlantModel.from_dict({"gsid_model": 1, "fs_hz": 3000, "effects": effects})
    with pytest.raises(InputError, match="with a gain of 0"):
        export_c(model)


def test_random_numbers_compile_or_are_refused(tmp_path):
    """Coefficients over the whole range of doubles (seed 13): what is exported has no warning."""
    rng = np.random.default_rng(13)
    n_exported = 0
    for _ in range(40):
        poles = -(10 ** rng.uniform(-6, 6, 3))
        num = rng.choice([-1, 1], 3) * 10 ** rng.uniform(-320, 45, 3)
        model = RationalModel(num, np.poly(poles), 10 ** rng.uniform(-9, 2), fs_hz=3000, hold="zoh")
        try:
            made = export_c(model, "rig")
        except InputError:
            continue
        n_exported += 1
        assert not re.search(r"\b(inf|nan)", made.source)
        assert compiled(made, tmp_path, "c99") == ""
    assert n_exported > 10


def test_a_table_of_a_command_has_a_name_that_c_takes(tmp_path):
    """Bug: `gsid design -o float.h` declared `static const float float[]`."""
    from gsid.cli.main import main

    for stem in ("float", "größe", "2fast", "math", "a-b"):
        path = tmp_path / f"{stem}.h"
        basic = ["design", "multisine", "--fs", "100", "--period", "40", "--band", "5:20"]
        assert main([*basic, "-o", str(path)]) == 0
        header = Path(tmp_path / "table.h")
        header.write_text(path.read_text(encoding="utf-8"))
        name = re.search(r"static const float (\w+)\[", header.read_text()).group(1)
        (tmp_path / "use.c").write_text(
            f'#include "table.h"\nint f(void);\nint f(void) {{ return {name}[0] > 0; }}\n'
        )
        result = subprocess.run(
            [*COMPILERS["c99"], "-c", "use.c"], cwd=tmp_path, capture_output=True, text=True
        )
        assert result.stderr == ""
