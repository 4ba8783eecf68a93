"""The programs and the session of README.md do what README.md says they do."""

import re
import shlex
import shutil
import sys

import numpy as np
import pages
from pages import assert_same_text, commands

from measured import BENCH, needs_bench


def blocks(root, language):
    return pages.blocks(root / "README.md", language)


def test_the_c_program(run, root, tmp_path):
    (tmp_path / "example.c").write_text(blocks(root, "c")[0])
    for folder in ("include", "build"):
        (tmp_path / folder).symlink_to(root / folder)
    ((command, shown),) = commands(blocks(root, "console")[1])
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


def test_the_run_over_a_serial_line(run, root, tmp_path):
    script = re.sub(
        r"^gsid ", f"{shlex.quote(str(root / '.venv/bin/gsid'))} ", blocks(root, "sh")[1], flags=re.M
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
    for command, shown in commands(blocks(root, "console")[0]):
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


def test_the_missing_effect(run, root, tmp_path):
    """The records of the text, made by the simulated axis; the commands of the text, word for word."""
    from gsid.excitation import Multisine
    from gsid.io import write_record
    from gsid.record import Record
    from gsid.simulate import SimulatedAxis

    (tmp_path / "axis.json").write_text(blocks(root, "json")[0])
    for seed in (1, 2, 3):
        m = Multisine.design(3000, 6000, (0.5, 195), grid="odd", phases="random", seed=seed, amplitude=3)
        u, y, _ = SimulatedAxis(coulomb_level=2.0, seed=seed).step(np.tile(m.table(), 10))
        record = Record(u, y, 3000, period_samples=6000, settle_samples=12000, hold="zoh", y_unit="deg/s")
        write_record(tmp_path / f"rig{seed}.csv", record)
    for command, shown in commands(blocks(root, "shell-session")[0]):
        gsid, *arguments = shlex.split(command)
        assert gsid == "gsid"
        result = run(sys.executable, "-m", "gsid.cli.main", *arguments, cwd=tmp_path)
        assert result.returncode == 0, result.stderr
        words = shown.split("(")[0].split(":")[0]  # the noise is drawn anew: its figures are not the text's
        assert result.stdout.startswith(words), result.stdout
