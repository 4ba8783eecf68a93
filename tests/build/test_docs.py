"""What `make docs` shows of the code is whole."""

import re
import sys

import pytest


@pytest.fixture(scope="module")
def headers(root):
    sys.path.insert(0, str(root / "docs/_extensions"))
    try:
        import c_headers
    finally:
        sys.path.pop(0)
    return c_headers.headers(root / "include")


def test_every_public_c_function_is_found(headers, root):
    """Against another reading of the headers: every name before a bracket, comments and macros taken away."""
    for header in headers:
        source = (root / "include" / header.name).read_text()
        source = re.sub(r"/\*.*?\*/", "", source, flags=re.S)
        source = re.sub(r"^#.*(?:\\\n.*)*$", "", source, flags=re.M)
        names = set(re.findall(r"\b(gsid_\w+)\(", source))
        assert names == {function.name for function in header.functions}, header.name


def test_every_public_c_function_has_a_comment(headers):
    functions = [function for header in headers for function in header.functions]
    assert len(functions) > 100
    assert [function.name for function in functions if not function.text] == []


def test_every_page_is_of_one_kind(root):
    kinds = {"tutorial", "how-to", "reference", "explanation"}
    for page in (root / "docs").rglob("*.md"):
        parts = page.relative_to(root / "docs").parts
        assert parts == ("index.md",) or (len(parts) == 2 and parts[0] in kinds), page
