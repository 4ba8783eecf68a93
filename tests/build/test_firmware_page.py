"""docs/firmware.md: the files it names are enough to link."""

import re

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
    table = (root / "docs/firmware.md").read_text().split("## Which files")[1].split("## Which flags")[0]
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
