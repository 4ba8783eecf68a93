"""Headers of one precision and an archive of the other must not link."""

import re

import pytest

USER = """
#include "gsid/gsid.h"
int main(void) {
    gsid_cplx table[8];
    return (int)gsid_twiddle_fill(8, table);
}
"""


@pytest.mark.parametrize(("headers", "archive"), [("double", "float"), ("float", "double")])
def test_a_mix_of_precisions_fails_at_link_time(run, root, tmp_path, headers, archive):
    (tmp_path / "user.c").write_text(USER)
    define = ["-DGSID_SINGLE"] if headers == "float" else []

    def link(precision):
        library = root / "build" / precision / "libgsid_core.a"
        compile_user = ["cc", "-std=c99", *define, f"-I{root / 'include'}", "-o", tmp_path / "user"]
        return run(*compile_user, tmp_path / "user.c", library, "-lm")

    assert link(headers).returncode == 0  # it is the mix that fails, not the program
    mixed = link(archive)
    assert mixed.returncode != 0
    assert f"gsid_twiddle_fill_{'f32' if headers == 'float' else 'f64'}" in mixed.stderr


def test_every_function_that_sees_a_real_carries_its_precision(root):
    """No plain function of the core's headers mentions gsid_real or a struct built of it."""
    precision = (root / "include/gsid/precision.h").read_text()
    renamed = set(re.findall(r"#define (gsid_\w+) GSID_NAME", precision))
    text = "\n".join(path.read_text() for path in sorted((root / "include/gsid").glob("*.h")))
    text = re.sub(r"/\*.*?\*/|^#.*?(?<!\\)$", "", text, flags=re.DOTALL | re.MULTILINE)
    declared = dict(re.findall(r"^[\w ]+?[ *](gsid_\w+)\(([^;{]*)\);", text, flags=re.MULTILINE))
    free_of_reals = {"gsid_status", "gsid_frame", "gsid_link", "gsid_grid", "gsid_domain", "gsid_trip"}
    for name, arguments in declared.items():
        types = set(re.findall(r"\bgsid_\w+", arguments))
        # A function without such an argument may do without the suffix; one with it may not.
        assert not (types - free_of_reals) or name in renamed, f"{name} needs a line in precision.h"
    assert len(declared) > 30  # the headers were read at all
    nowhere = renamed - set(re.findall(r"\bgsid_\w+", text))
    assert not nowhere, f"{nowhere} of precision.h is declared nowhere"
