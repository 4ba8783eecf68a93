"""docs/reference/equations.md lists the equation keys of the tree, all and no others, and their files."""

import re

import pytest

# What looks like a key and is none: licences, checksums, encodings.
NOT_KEYS = {"BSD", "CRC", "GPL", "MIT", "SHA", "UTF"}
KEY = re.compile(r"\b([A-Z]{3})-\d+\b")
IMPLEMENTING = ("include", "src", "python")
READING = (*IMPLEMENTING, "tests", "benchmarks", "docs", "firmware_examples", "README.md", "CONTRIBUTING.md")


def keys_in(text: str) -> set[str]:
    return {match.group() for match in KEY.finditer(text) if match.group(1) not in NOT_KEYS}


def used(root, places) -> dict[str, set[str]]:
    """Each key in these places, with the files that name it."""
    files: dict[str, set[str]] = {}
    for place in places:
        for path in [root / place] if (root / place).is_file() else (root / place).rglob("*"):
            if path.suffix in {".c", ".h", ".py", ".md"} and path.name not in {
                "equations.md",
                "test_equations.py",
            }:
                for key in keys_in(path.read_text()):
                    files.setdefault(key, set()).add(str(path.relative_to(root)))
    return files


@pytest.fixture(scope="module")
def page(root) -> dict[str, str]:
    """Each key's part of the page."""
    parts = re.split(r"^### (\S+) .*$", (root / "docs/reference/equations.md").read_text(), flags=re.M)
    keys = parts[1::2]
    assert len(keys) == len(set(keys)), "a key is listed twice"
    return dict(zip(keys, (part.split("\n## ")[0] for part in parts[2::2]), strict=True))


def test_every_key_used_is_listed(page, root):
    unknown = {key: sorted(files) for key, files in used(root, READING).items() if key not in page}
    assert not unknown, (
        "list these in docs/reference/equations.md, or their first letters in NOT_KEYS if they are no keys"
    )


def test_every_key_listed_is_used(page, root):
    assert set(page) <= set(used(root, IMPLEMENTING))


def test_every_key_names_the_files_that_implement_it(page, root):
    files = used(root, IMPLEMENTING)
    for key, part in page.items():
        line = re.search(r"^In: (.+)\.$", part, flags=re.M)
        assert line, f"{key} does not say where it stands"
        for path in re.findall(r"`([^`]+)`", line.group(1)):
            assert path in files[key], f"{path} does not name {key}"


def test_every_key_has_a_formula_and_a_source(page):
    for key, part in page.items():
        assert re.search(r"^ {4}\S", part, flags=re.M), f"{key} has no formula"
        assert re.search(r"^Source: \S", part, flags=re.M), f"{key} has no source"


def test_the_pattern_sees_keys_and_only_keys():
    assert keys_in("Eq: EST-1 to EST-6. (CMP-2), ABC-12; CRC-16, SHA-256, TEST-1, BSD-3") == {
        "EST-1",
        "EST-6",
        "CMP-2",
        "ABC-12",
    }
