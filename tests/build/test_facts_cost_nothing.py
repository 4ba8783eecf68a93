"""Firmware that links a plant does not pay for the facts that fits and the documentation need."""

import pytest

PLANT = """
#include "gsid/gsid.h"

int main(void) {
    gsid_plant_item item[1];
    item[0].effect = gsid_catalogue_find("coulomb_friction");
    return item[0].effect == NULL || gsid_n_catalogue < 20;
}
"""


@pytest.fixture
def linked(run, root, tmp_path):
    """Link a program with all effects as firmware is linked, and list the symbols of the image."""

    def linked(*linker_flags):
        (tmp_path / "main.c").write_text(PLANT)
        flags = [
            "-std=c99",
            "-Os",
            "-ffunction-sections",
            "-fdata-sections",
            "-DGSID_SINGLE",
            f"-I{root}/include",
        ]
        sources = [*sorted((root / "src/effects").glob("*.c")), *sorted((root / "src/core").glob("*.c"))]
        made = run(
            "cc", *flags, *linker_flags, "-o", tmp_path / "image", tmp_path / "main.c", *sources, "-lm"
        )
        assert made.returncode == 0, made.stderr
        assert run(tmp_path / "image").returncode == 0
        return run("nm", tmp_path / "image").stdout

    return linked


@pytest.mark.long
def test_the_facts_of_the_effects_are_not_in_the_image(linked):
    assert "gsid_facts_coulomb_friction" in linked()
    dropped = linked("-Wl,--gc-sections")
    assert "gsid_effect_coulomb_friction" in dropped
    assert "gsid_facts_" not in dropped
    assert "gsid_catalogue_facts" not in dropped
