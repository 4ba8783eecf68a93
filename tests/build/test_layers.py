"""tools/check_layers passes on the tree, and does fail on each kind of violation it is there for."""

import sys

import pytest

FILES = {
    "include/gsid/gsid.h": "typedef int gsid_status;\n",
    "include/gsid/host.h": '#include "gsid/host/axis.h"\n#include "gsid/host/fit.h"\n',
    "include/gsid/host/axis.h": "typedef int gsid_axis;\n",
    "include/gsid/host/fit.h": "typedef int gsid_fit;\n",
    "src/core/status.c": '#include "gsid/gsid.h"\n',
    "src/effects/laws.c": '#include "gsid/gsid.h"\n',
    "src/host/fit.c": '#include "gsid/host/fit.h"\n#include "backend/backend.h"\n',
    "src/host/backend/backend.h": "typedef int gsid_backend;\n",
}
MODULES = (
    *("_lib", "effects", "base/errors", "records/record", "spectrum/spectra", "plant/model"),
    *("models/rational", "fitting/fit", "greybox/fit", "comparison/compare", "rig/link", "plots/style"),
    "report/page",
)


@pytest.fixture
def tree(tmp_path):
    """Sources and a package, without a violation: checked in a fraction of the time of all."""
    for file, text in FILES.items():
        (tmp_path / file).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / file).write_text(text)
    for module in MODULES:
        file = (tmp_path / "python/gsid" / module).with_suffix(".py")
        file.parent.mkdir(parents=True, exist_ok=True)
        (file.parent / "__init__.py").touch()
        file.touch()
    return tmp_path


@pytest.fixture
def check(run, root, tmp_path):
    """Run the check on a tree, with a core archive made of pieces of C, an object each."""

    def check(tree, *core_code):
        objects = []
        for number, code in enumerate(core_code):
            source = tmp_path / f"planted_{number}.c"
            objects.append(source.with_suffix(".o"))
            source.write_text(code)
            flags = ["-std=c99", "-fPIC", "-fno-stack-protector"]
            assert run("cc", *flags, "-c", "-o", objects[-1], source).returncode == 0
        archives = []
        if objects:
            assert run("ar", "rcs", tmp_path / "planted.a", *objects).returncode == 0
            archives = ["--core", tmp_path / "planted.a"]
        return run(sys.executable, root / "tools/check_layers", "--root", tree, *archives)

    return check


def test_the_tree_as_it_stands_is_clean(check, root):
    result = check(root)
    assert result.returncode == 0, result.stderr


def test_the_small_tree_is_clean(check, tree):
    result = check(tree)
    assert result.returncode == 0, result.stderr


@pytest.mark.parametrize(
    ("file", "include", "said"),
    [
        ("src/core/planted.c", "<fftw3.h>", "<fftw3.h> is not for the core"),
        ("src/core/planted.c", "<stdio.h>", "<stdio.h> is not for the core"),
        ("src/core/planted.c", '"gsid/host/axis.h"', "the core includes gsid/host/axis.h of the host"),
        ("src/core/planted.c", '"../host/backend/backend.h"', "of the host"),
        ("src/effects/planted.c", '"gsid/host.h"', "the effects includes gsid/host.h of the host"),
        ("src/host/planted.c", "<nlopt.h>", "<nlopt.h> is not for the host"),
        ("include/gsid/planted.h", '"gsid/host/fit.h"', "the core includes gsid/host/fit.h of the host"),
        ("src/core/planted.c", '"nowhere.h"', "neither beside the file nor in include/"),
    ],
)
def test_an_include_against_the_layers_is_found(check, tree, file, include, said):
    (tree / file).write_text(f"#include {include}\n")
    result = check(tree)
    assert result.returncode == 1
    assert f"error: {file}:1: " in result.stderr
    assert said in result.stderr


@pytest.mark.parametrize(
    ("file", "include"),
    [
        ("src/host/backend/planted.c", "<fftw3.h>"),
        ("src/host/planted.c", '"gsid/gsid.h"'),
        ("src/effects/planted.c", '"gsid/gsid.h"'),
    ],
)
def test_an_include_along_the_layers_is_accepted(check, tree, file, include):
    (tree / file).write_text(f"#include {include}\n")
    result = check(tree)
    assert result.returncode == 0, result.stderr


@pytest.mark.parametrize(
    "files",
    [
        {"planted_a.h": "planted_b.h", "planted_b.h": "planted_a.h"},
        {"planted_a.c": "planted_b.h", "planted_b.c": "planted_a.h", "planted_a.h": "", "planted_b.h": ""},
        {"planted_a.h": "planted_a.h"},
    ],
    ids=["headers", "a source and its header count as one", "a header that includes itself"],
)
def test_a_cycle_of_includes_is_found(check, tree, files):
    for file, include in files.items():
        (tree / "src/core" / file).write_text(f'#include "{include}"\n' if include else "\n")
    result = check(tree)
    assert result.returncode == 1
    assert "error: cycle of includes: src/core/planted_" in result.stderr


def test_a_cycle_of_calls_between_objects_is_found(check, tree):
    one = "int gsid_two(void); int gsid_one(void) { return 1; } int gsid_three(void) { return gsid_two(); }"
    other = "int gsid_one(void); int gsid_two(void) { return gsid_one(); }"
    result = check(tree, one, other)
    assert result.returncode == 1
    assert "cycle of calls: planted_" in result.stderr


def test_calls_one_way_between_objects_are_accepted(check, tree):
    one = "int gsid_one(void) { return 1; }"
    other = "int gsid_one(void); int gsid_two(void) { return gsid_one(); }"
    result = check(tree, one, other)
    assert result.returncode == 0, result.stderr


@pytest.mark.parametrize(
    ("code", "said"),
    [
        ("#include <stdlib.h>\nvoid *gsid_planted(void) { return malloc(8); }", "needs malloc"),
        ("#include <stdio.h>\nvoid gsid_planted(double x) { printf(\"%g\", x); }", "needs printf"),
        ("#include <errno.h>\nint gsid_planted(void) { return errno; }", "needs __errno_location"),
        ("int planted(void) { return 0; }", "defines planted, which does not begin with gsid_"),
    ],
)  # fmt: skip
def test_a_symbol_that_the_core_must_not_have_is_found(check, tree, code, said):
    result = check(tree, code)
    assert result.returncode == 1
    assert said in result.stderr


def test_the_short_list_is_accepted(check, tree):
    code = """
    #include <math.h>
    #include <string.h>
    double gsid_planted(double *x, const double *y, size_t n) { memcpy(x, y, n); return sin(*x); }
    """
    result = check(tree, code)
    assert result.returncode == 0, result.stderr


def test_a_header_that_does_not_stand_alone_is_found(check, tree):
    (tree / "include/gsid/planted.h").write_text("gsid_status gsid_planted(void);\n")
    result = check(tree)
    assert result.returncode == 1
    assert "include/gsid/planted.h: does not compile alone" in result.stderr


@pytest.mark.parametrize(
    ("file", "code", "reported"),
    [
        ("base/planted.py", "from gsid.plots import style\n", "base imports gsid.plots.style of plots"),
        (
            "records/planted.py",
            "import gsid.spectrum.spectra\n",
            "records imports gsid.spectrum.spectra of spectrum",
        ),
        (
            "plant/planted.py",
            "def f():\n    from gsid.greybox import fit\n",
            "plant imports gsid.greybox.fit of greybox",
        ),
        (
            "fitting/planted.py",
            "from gsid import comparison\n",
            "fitting imports gsid.comparison of comparison",
        ),
        (
            "models/planted.py",
            "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from gsid.rig.link import Link\n",
            "models imports gsid.rig.link of rig",
        ),
        ("report/planted.py", "from gsid import Record\n", "imports from gsid itself: name the module"),
        ("planted.py", "import math\nfrom gsid.base import errors\n", "planted has no place in the order"),
    ],
)
def test_a_python_import_against_the_order_is_found(check, tree, file, code, reported):
    (tree / "python/gsid" / file).write_text(code)
    result = check(tree)
    assert result.returncode == 1
    assert f"error: python/gsid/{file}:{len(code.splitlines())}: " in result.stderr
    assert reported in result.stderr


def test_a_python_import_along_the_order_passes(check, tree):
    code = "from gsid import effects\nfrom gsid._lib import lib\nfrom gsid.records.record import Record\n"
    (tree / "python/gsid/rig/planted.py").write_text(code)
    result = check(tree)
    assert result.returncode == 0, result.stderr


def test_python_files_that_import_each_other_are_found(check, tree):
    for one, other in (("a", "b"), ("b", "c"), ("c", "a")):
        (tree / f"python/gsid/plots/planted_{one}.py").write_text(
            f"def f():\n    from gsid.plots.planted_{other} import f\n"
        )
    result = check(tree)
    assert result.returncode == 1
    reported = [line for line in result.stderr.splitlines() if "files import each other" in line]
    assert len(reported) == 1
    assert all(f"gsid.plots.planted_{one}" in reported[0] for one in "abc")
    assert "planted_a -> gsid.plots.planted_b" in reported[0]
