"""docs/how-to/firmware.md: the files it names are enough to link."""

import re
import shutil

import numpy as np
import pages
import pytest

ROW = re.compile(r"^\| ([^|]+) \| ([^|]*`[^|]*) \|$", flags=re.M)


def sources_of(root, cell):
    """Paths of the files, patterns and folders that a cell of the table names."""
    names = " ".join(re.findall(r"`([^`]+)`", cell)).split()
    patterns = [f"{name}*.c" if name.endswith("/") else f"src/core/{name}" for name in names]
    found = [sorted(root.glob(pattern)) for pattern in patterns]
    assert all(found), patterns
    return {path for paths in found for path in paths}


def rows_of(root):
    """Sources of each row, by what it is for; the first is the base of the others."""
    text = (root / "docs/how-to/firmware.md").read_text()
    table = text.split("## Which files")[1].split("## Which flags")[0]
    return {name: sources_of(root, cell) for name, cell in ROW.findall(table)[1:]}


def symbols_of(run, archive):
    """By object of an archive: the names it defines, and those of gsid that it needs."""
    defines, needs = {}, {}
    for member, listing in re.findall(r"^(\w+)\.o:\n((?:.+\n)*)", run("nm", archive).stdout, flags=re.M):
        symbols = re.findall(r"\b([A-Za-z]) _?(gsid_\w+)", listing)
        needs[member] = {name for kind, name in symbols if kind == "U"}
        defines[member] = {name for kind, name in symbols if kind != "U"}
    return defines, needs


def test_each_row_links_with_the_base(run, root):
    """Bug: the fitted model lacked equations.c, and gauss_newton.c with ML; the plant lacked lsq.c."""
    defines, needs = {}, {}
    for archive in ("core", "effects"):
        more = symbols_of(run, root / f"build/float/libgsid_{archive}.a")
        defines, needs = defines | more[0], needs | more[1]
    rows = rows_of(root)
    base = next(iter(rows.values()))
    for name, paths in rows.items():
        members = [path.stem for path in base | paths]
        needed = set().union(*(needs[member] for member in members))
        assert needed - set().union(*(defines[member] for member in members)) == set(), name


def test_every_source_of_the_core_is_in_a_row(root):
    assert set((root / "src/core").glob("*.c")) - set().union(*rows_of(root).values()) == set()


SENDS_WHOLE_NUMBERS = """
int main(void) {
    float y = 0;
    if (measure_init() != GSID_OK)
        return 1;
    gsid_multisine designed;
    const gsid_multisine_cfg cfg = {N_PERIOD, N_LINES, line, amplitude, phase_rad, twiddle};
    gsid_cplx of_designed[N_LINES], g[N_LINES];
    gsid_multisine_init(&designed, &cfg);
    gsid_multisine_spectrum(&designed, of_designed);
    while (frf.n_periods < N_GOOD) {
        const uint32_t now = n;
        measure_tick(y);
        y = command[now]; /* the axis: the command, one sample late */
    }
    const gsid_frf_out out = {.g = g};
    if (gsid_frf_result(&frf, &out) != GSID_OK)
        return 1;
    for (uint32_t i = 0; i < N_LINES; i++) {
        const gsid_cplx z[] = {g[i], input[i], of_designed[i]};
        for (int k = 0; k < 3; k++)
            printf("%.9g %.9g ", z[k].re, z[k].im);
        printf("\\n");
    }
}
"""


def test_lines_of_a_rounded_command(run, root, tmp_path):
    (block,) = pages.blocks(root / "docs/how-to/firmware.md", "c")
    copied = (root / "firmware_examples/minimal/main.c").read_text()
    copied = copied[copied.index("#include") : copied.index("/* ---- to here")]
    copied = copied.replace("gsid_multisine_spectrum(&multisine, input)", "round_command(179)")
    copied = copied.replace("/* Background, at the start", f"{block}\n/* Background, at the start")
    (tmp_path / "user.c").write_text(copied + SENDS_WHOLE_NUMBERS)
    flags = [
        "-std=c99",
        "-Wall",
        "-Wextra",
        "-Wconversion",
        "-Werror",
        "-DGSID_SINGLE",
        f"-I{root / 'include'}",
    ]
    library = root / "build/float/libgsid_core.a"
    compiled = run("cc", *flags, "-o", tmp_path / "user", tmp_path / "user.c", library, "-lm")
    assert compiled.returncode == 0, compiled.stderr
    result = run(tmp_path / "user")
    assert result.returncode == 0
    g, sent, designed = np.array([r.split() for r in result.stdout.splitlines()], float).view(complex).T
    # Single precision: 2e-6 of the largest line (include/gsid/frf.h).
    np.testing.assert_allclose(g, np.exp(-2j * np.pi * np.arange(1, 51) / 600), rtol=0, atol=4e-6)
    scale = np.vdot(designed, sent) / np.vdot(designed, designed)
    off = np.sqrt(np.mean(np.abs(sent / (scale * designed) - 1) ** 2))
    assert off == pytest.approx(0.001, abs=0.0005)  # the page's figure


def test_fast_math_does_not_compile(run, root):
    compiled = run("cc", "-std=c99", "-ffast-math", "-Iinclude", "-fsyntax-only", "src/core/frf.c", cwd=root)
    assert compiled.returncode != 0
    assert "not with -ffast-math" in compiled.stderr


SELF_CHECK = """
#include <stdio.h>

#include "gsid/frf.h"
#include "gsid/guard.h"

static union { gsid_cplx align; unsigned char bytes[4096]; } memory;

int main(void) {
    static gsid_cplx twiddle[8] = {{1, 0}}, known[1] = {{1, 0}};
    const uint32_t line[1] = {1};
    const gsid_frf_cfg cfg = {.n_period = 8, .n_lines = 1, .line = line, .twiddle = twiddle,
                              .u_known = known};
    const gsid_spectrum_cfg spectrum_cfg = {.n_period = 8, .n_lines = 1, .n_channels = 1, .line = line,
                                            .twiddle = twiddle};
    const gsid_guard_cfg limits = {.fs_hz = 1000, .command_limit = 1, .rate_limit = 1, .angle_lo = -1,
                                   .angle_hi = 1, .deceleration = 1};
    gsid_frf frf;
    gsid_spectrum spectrum;
    gsid_spread spread;
    gsid_guard guard;
    printf("%d %d %d %d %d\\n", gsid_frf_init(&frf, &cfg, &memory, sizeof memory),
           gsid_frf_init_spread(&frf, &cfg, &memory, sizeof memory),
           gsid_spectrum_init(&spectrum, &spectrum_cfg, &memory, sizeof memory),
           gsid_spread_init(&spread, &spectrum_cfg, &memory, sizeof memory),
           gsid_guard_init(&guard, &limits));
    return 0;
}
"""


@pytest.mark.parametrize(
    ("compiler", "flags", "status"),
    [
        ("cc", [], 0),
        # What GCC does without NaNs; it says so in a macro, which is taken away here.
        ("cc", ["-ffinite-math-only", "-U__FINITE_MATH_ONLY__"], -12),
        ("clang", ["-fno-honor-nans"], -12),  # defines no macro
    ],
)
@pytest.mark.parametrize("precision", [[], ["-DGSID_SINGLE"]])
def test_a_library_that_does_not_see_nan_refuses_to_start(
    run, root, tmp_path, compiler, flags, status, precision
):
    if shutil.which(compiler) is None:
        pytest.skip(f"there is no {compiler}")
    (tmp_path / "main.c").write_text(SELF_CHECK)
    sources = sorted((root / "src/core").glob("*.c"))
    program = tmp_path / "main"
    words = ["-std=c99", "-O2", *flags, *precision, f"-I{root / 'include'}", tmp_path / "main.c", *sources]
    compiled = run(compiler, *words, "-o", program, "-lm")
    assert compiled.returncode == 0, compiled.stderr
    assert run(program).stdout.split() == [str(status)] * 5
