"""What `make docs` shows of the code is whole."""

import inspect
import pkgutil
import re
import sys

import pytest

import gsid


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


def test_every_public_python_name_has_a_docstring():
    """The names that the site has; make docs checks the methods of the classes too."""
    things = {name: getattr(gsid, name) for name in gsid.__all__ if not name.startswith("_")}
    assert len(things) > 20
    assert [name for name, thing in things.items() if not inspect.getdoc(thing)] == []


def test_every_class_that_a_public_function_returns_is_public():
    public = [getattr(gsid, name) for name in gsid.__all__]
    for function in filter(inspect.isfunction, public):
        for word in re.findall(r"\w+", str(function.__annotations__.get("return", ""))):
            result = function.__globals__.get(word)
            if inspect.isclass(result) and result.__module__.startswith("gsid"):
                assert result in public, f"{function.__name__} returns {word}"


def test_every_page_is_listed_in_its_index(root):
    """A page that no index lists has no place in the site."""
    for page in (root / "docs").glob("*/*.md"):
        listed = (page.parent / "index.md").read_text().split("{toctree}")[1].split()
        assert page.stem in {*listed, "index"}, f"add {page.stem} to {page.parent.name}/index.md"


def test_every_page_is_of_one_kind(root):
    kinds = {"tutorial", "how-to", "reference", "explanation"}
    for page in (root / "docs").rglob("*.md"):
        parts = page.relative_to(root / "docs").parts
        assert parts == ("index.md",) or (len(parts) == 2 and parts[0] in kinds), page


def test_every_python_name_on_a_page_can_be_imported(root):
    """A bug: a page cited a function that had moved away."""
    names = {
        (name, page.relative_to(root))
        for page in [root / "README.md", root / "CONTRIBUTING.md", *(root / "docs").rglob("*.md")]
        for name in re.findall(r"(?<![\w./-])gsid(?:\.[A-Za-z_]\w*)+", page.read_text())
        if name not in ("gsid.h", "gsid.c", "gsid.pc")
    }
    missing = []
    for name, page in sorted(names):
        try:
            pkgutil.resolve_name(name)
        except (ImportError, AttributeError) as error:
            missing.append(f"{page}: {name}: {error}")
    assert len(names) > 20
    assert missing == []
