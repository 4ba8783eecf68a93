"""docs/how-to/c.md: its programs are short, compile without a warning, and print what the page shows."""

import pages
import pytest

from gsid._lib import ffi, lib

LINES_MOST = (60, 66)  # a rational model; a plant
LIBRARIES = {
    "fftw": ["-lfftw3", "-lpthread"],
    "nlopt": ["-lnlopt"],
    "suitesparse": ["-lspqr", "-lcholmod", "-lsuitesparseconfig"],
}
ARCHIVES = ("libgsid_host.a", "double/libgsid_effects.a", "double/libgsid_core.a")


@pytest.mark.parametrize("number", range(len(LINES_MOST)))
def test_a_program_of_the_page_prints_what_it_shows(run, root, tmp_path, number):
    page = root / "docs/how-to/c.md"
    programs, outputs = pages.blocks(page, "c"), pages.blocks(page, "text")
    assert len(programs) == len(outputs) == len(LINES_MOST)
    program, shown = programs[number], outputs[number]
    assert len(program.splitlines()) <= LINES_MOST[number]
    (tmp_path / "study.c").write_text(program)
    used = [name for name in LIBRARIES if ffi.string(lib.gsid_build_library_version(name.encode()))]
    built = run(
        *("cc", "-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror", "-I", root / "include"),
        *("-o", tmp_path / "study", tmp_path / "study.c", *(root / "build" / name for name in ARCHIVES)),
        *(option for name in used for option in LIBRARIES[name]),
        "-lm",
    )
    assert built.returncode == 0, built.stderr
    printed = run(tmp_path / "study")
    assert printed.returncode == 0, printed.stdout
    pages.assert_same_text(printed.stdout, shown)
