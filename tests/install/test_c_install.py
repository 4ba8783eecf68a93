"""Projects that use the installed C libraries, or a clone, build and run."""

import re
import shutil
from pathlib import Path

import pytest
from projects import HERE, ROOT, cmake_project, require, run

pytestmark = pytest.mark.xdist_group("installed")


def check_programs(out: Path, *names: str, **variables) -> None:
    for name in names:
        printed = run(out / name, **variables).stdout
        if name.startswith("lowpass"):
            assert ("4 bytes" if name.endswith("single") else "8 bytes") in printed


@pytest.mark.parametrize("linked", ["shared", "static"])
def test_a_project_finds_the_libraries_by_pkg_config(installed, tmp_path, linked):
    lib = installed.prefix / "lib"
    static = [] if linked == "shared" else ["STATIC=--static", "LDFLAGS=-L/usr/lib"]
    programs = ["lowpass", "lowpass_single"]
    if (
        linked == "shared"
    ):  # a static program needs static FFTW, NLopt and SuiteSparse, which few systems have
        programs.append("tone")
    targets = [tmp_path / name for name in programs]
    run(
        *("make", "-C", HERE / "pkg_config", f"OUT={tmp_path}", *static, *targets),
        PKG_CONFIG_PATH=str(lib / "pkgconfig"),
    )
    check_programs(tmp_path, *programs, **({"LD_LIBRARY_PATH": str(lib)} if linked == "shared" else {}))


def test_a_project_finds_the_libraries_by_find_package(installed, tmp_path):
    cmake_project("cmake_package", tmp_path, f"-DCMAKE_PREFIX_PATH={installed.prefix}")
    check_programs(tmp_path, "lowpass", "lowpass_single", "tone", "tone_shared")


def test_find_package_refuses_another_minor_version(installed, tmp_path):
    project = tmp_path / "CMakeLists.txt"
    project.write_text(
        "cmake_minimum_required(VERSION 3.16)\nproject(user C)\nfind_package(gsid 0.0.9 REQUIRED)\n"
    )
    result = run(
        *("cmake", "-S", tmp_path, "-B", tmp_path / "out", f"-DCMAKE_PREFIX_PATH={installed.prefix}"),
        check=False,
    )
    assert result.returncode != 0
    assert "compatible" in result.stderr


def test_a_project_has_a_clone_as_subdirectory(tmp_path):
    require("cmake")
    cmake_project("cmake_subdirectory", tmp_path, f"-DGSID_CLONE={ROOT}")
    check_programs(tmp_path, "lowpass", "lowpass_single", "tone")


def test_a_clone_as_subdirectory_builds_only_what_is_linked(tmp_path):
    require("cmake")
    run("cmake", "-S", HERE / "cmake_subdirectory", "-B", tmp_path, f"-DGSID_CLONE={ROOT}")
    run("cmake", "--build", tmp_path, "--target", "lowpass_single", "-j2")
    assert [path.name for path in tmp_path.rglob("*.a")] == ["libgsid_core_single.a"]


def test_a_project_fetches_gsid(tmp_path):
    """The repository is made of the files as they are, so that the test does not depend on commits."""
    require("cmake", "git")
    clone = tmp_path / "clone"
    for folder in ("include", "src"):
        shutil.copytree(ROOT / folder, clone / folder)
    shutil.copy(ROOT / "CMakeLists.txt", clone)
    git = ["git", "-C", clone, "-c", "user.name=test", "-c", "user.email=test@localhost"]
    run(*git, "init", "-q", "-b", "main")
    run(*git, "add", ".")
    run(*git, "commit", "-q", "-m", "as it is")
    cmake_project("cmake_fetch", tmp_path / "out", f"-DGSID_CLONE={clone}", "-DGSID_TAG=main")
    check_programs(tmp_path / "out", "lowpass_single")


def test_shared_libraries_have_a_soname_with_the_minor_version(installed):
    version = re.search(r'GSID_VERSION "(\d+\.\d+)', (ROOT / "include/gsid/types.h").read_text())[1]
    for name in ("core", "core_single", "host"):
        dynamic = run("readelf", "-d", installed.prefix / f"lib/libgsid_{name}.so").stdout
        assert f"soname: [libgsid_{name}.so.{version}]" in dynamic


def test_the_host_library_needs_its_core_at_load_time(installed):
    dynamic = run("readelf", "-d", installed.prefix / "lib/libgsid_host.so").stdout
    assert "libgsid_core.so" in dynamic


def test_every_public_header_is_installed(installed):
    names = {path.relative_to(ROOT / "include") for path in (ROOT / "include").rglob("*.h")}
    include = installed.prefix / "include"
    assert {path.relative_to(include) for path in include.rglob("*.h")} == names


def test_uninstall_leaves_nothing_below_destdir(installed, tmp_path):
    installed.make("install", f"DESTDIR={tmp_path}")
    assert any(path.is_file() for path in tmp_path.rglob("*"))
    installed.make("uninstall", f"DESTDIR={tmp_path}")
    assert [path for path in tmp_path.rglob("*") if not path.is_dir()] == []
    assert not list(tmp_path.rglob("gsid"))


def test_uninstall_of_nothing_is_an_error(tmp_path):
    result = run("make", "uninstall", f"BUILD={tmp_path}", check=False)
    assert result.returncode != 0
    assert "error: nothing was installed" in result.stderr
    assert "hint: " in result.stderr
