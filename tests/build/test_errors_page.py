"""docs/reference/errors.md says what the library says."""

import sys


def test_the_page_of_status_codes_is_up_to_date(run, root):
    made = run(sys.executable, root / "tools/make_errors_page")
    assert made.returncode == 0, made.stderr
    assert (root / "docs/reference/errors.md").read_text() == made.stdout, "call: make errors-page"


def test_every_failure_of_the_list_becomes_an_exception():
    import pytest

    from gsid import GsidError
    from gsid._lib import check, lib

    assert check(lib.GSID_DONE) == lib.GSID_DONE
    with pytest.raises(GsidError, match="laying out: the memory block is too small") as raised:
        check(lib.GSID_E_MEMORY, "laying out")
    assert raised.value.code == lib.GSID_E_MEMORY
    assert "_mem_size" in raised.value.hint
