"""A C++ program calls the functions of the headers by the names that the C archives give them."""

import re

import pytest

FUNCTION = r"^[\w ]+?[ *](gsid_\w+)\([^;{]*\);"


@pytest.mark.parametrize("umbrella", ["gsid/gsid.h", "gsid/host.h"])
def test_every_function_has_its_c_name(run, root, tmp_path, umbrella):
    """Bug: no header said extern "C", so that C++ compiled and did not link."""
    folders = ["gsid", "gsid/host"] if umbrella == "gsid/host.h" else ["gsid"]
    headers = [path for folder in folders for path in (root / "include" / folder).glob("*.h")]
    text = re.sub(r"/\*.*?\*/", "", "\n".join(path.read_text() for path in headers), flags=re.DOTALL)
    names = sorted(set(re.findall(FUNCTION, text, flags=re.MULTILINE)))
    assert len(names) > 90  # the pattern still finds them
    uses = "\n".join(f"void use_{name}() {{ keep(&{name}); }}" for name in names)
    keep = "template <class T> void keep(T *f) { static T *volatile at; at = f; (void)at; }"
    code = f'#include "{umbrella}"\n{keep}\n{uses}\n'
    (tmp_path / "user.cpp").write_text(code)
    compiled = run(
        *("c++", "-std=c++11", "-Wall", "-Wextra", "-Werror", f"-I{root / 'include'}", "-c"),
        *("-o", tmp_path / "user.o", tmp_path / "user.cpp"),
    )
    assert compiled.returncode == 0, compiled.stderr
    undefined = re.findall(r"U (\S+)", run("nm", "-u", tmp_path / "user.o").stdout)
    assert [name for name in undefined if "gsid" in name and name.startswith("_Z")] == []
    assert len([name for name in undefined if name.startswith("gsid_")]) >= len(names)
