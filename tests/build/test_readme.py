"""The programs and the sessions of README.md print what it shows; test_tutorial.py has its first one."""

import re
import shlex
import shutil
import sys

import pages
import pytest
from pages import assert_same_text, commands

from measured import BENCH, needs_bench


def blocks(root, language):
    return pages.blocks(root / "README.md", language)


def test_the_c_program(run, root, tmp_path):
    (tmp_path / "example.c").write_text(blocks(root, "c")[0])
    for folder in ("include", "build"):
        (tmp_path / folder).symlink_to(root / folder)
    ((command, shown),) = commands(blocks(root, "console")[2])
    result = run(
        "sh", "-c", command.replace("-std=c99", "-std=c99 -pedantic -Wall -Wextra -Werror"), cwd=tmp_path
    )
    assert result.returncode == 0, result.stderr
    assert_same_text(result.stdout, shown)


def test_the_python_program(run, root, tmp_path):
    (tmp_path / "example.py").write_text(blocks(root, "python")[0])
    result = run(sys.executable, "example.py", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert_same_text(result.stdout, blocks(root, "text")[0])


@pytest.mark.long
def test_the_run_over_a_serial_line(run, root, tmp_path):
    script = re.sub(
        r"^gsid ", f"{shlex.quote(str(root / '.venv/bin/gsid'))} ", blocks(root, "sh")[2], flags=re.M
    )
    wait_for_port = "until [ -e axis ]; do sleep 0.1; done\n"  # a person's fingers are slower than the start
    first, rest = script.split("\n", 1)
    result = run("sh", "-ec", f"{first}\n{wait_for_port}{rest}wait", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert "<html" in (tmp_path / "rig.html").read_text()


@needs_bench
def test_the_session(run, root, tmp_path):
    for letter in "AB":
        shutil.copy(BENCH / f"multisine_{letter}.npz", tmp_path / f"bench_{letter.lower()}.npz")
    for command, shown in commands(blocks(root, "console")[1]):
        gsid = shlex.quote(str(root / ".venv/bin/gsid"))
        result = run("sh", "-c", re.sub(r"^gsid ", f"{gsid} ", command), cwd=tmp_path)
        assert result.returncode == 0, result.stderr
        assert_same_text(result.stdout, shown)


def test_links_between_pages_lead_somewhere(root):
    pages = [*root.glob("*.md"), *(root / "docs").rglob("*.md")]
    links = [(page, link) for page in pages for link in re.findall(r"\]\(([^)#:]+)\)", page.read_text())]
    assert len(links) > 5
    for page, link in links:
        assert (page.parent / link).exists(), f"{page.name} links to {link}"
