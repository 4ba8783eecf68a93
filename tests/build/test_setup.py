"""tools/setup and the Makefile: nothing to do the second time, and clear words where nothing can be done."""

import os
import shutil
import subprocess

import pytest


@pytest.fixture
def bare_path(tmp_path):
    """Return a PATH with a shell's tools and nothing else: no apt-get, no sudo."""
    for name in ("sh", "cat", "id", "mkdir", "tail", "env"):
        (tmp_path / name).symlink_to(shutil.which(name))
    return str(tmp_path)


def test_nothing_missing_is_silent(run, root):
    result = run("tools/setup")
    assert (result.returncode, result.stdout, result.stderr) == (0, "", "")


def test_what_is_missing_is_named_for_each_system(run, bare_path):
    result = run("tools/setup", PATH=bare_path, CC="nocc", PYTHON="nopython")
    assert result.returncode == 1
    assert "error: not found: a C compiler (nocc)" in result.stderr
    for line in (
        "python3 python3-venv python3-dev libfftw3-dev libnlopt-dev libsuitesparse-dev libcmocka-dev",
        "sudo dnf install gcc glibc-devel python3 python3-devel fftw-devel NLopt-devel suitesparse-devel",
        "sudo pacman -S --needed gcc glibc python fftw nlopt suitesparse cmocka",
        "brew install python fftw nlopt suite-sparse cmocka",
        "make WITH_FFTW=0 WITH_NLOPT=0 WITH_SUITESPARSE=0",
    ):
        assert line in result.stderr


def test_tools_for_firmware_are_required_separately(run, bare_path):
    result = run("tools/setup", "firmware", PATH=bare_path, CC="nocc")
    assert result.returncode == 1
    assert "sudo apt-get install gcc-arm-none-eabi libnewlib-arm-none-eabi qemu-system-arm\n" in result.stderr
    assert "nocc" not in result.stderr


def test_packages_for_benchmarks_are_required_separately(run, bare_path):
    result = run("tools/setup", "peers", PATH=bare_path, CC="nocc")
    assert result.returncode == 1
    assert "sudo apt-get install octave octave-signal octave-control\n" in result.stderr
    assert "nocc" not in result.stderr


def test_a_library_left_out_is_not_required(run, bare_path):
    result = run(
        "tools/setup",
        PATH=bare_path,
        CC="nocc",
        PYTHON="nopython",
        WITH_FFTW="0",
        WITH_NLOPT="0",
        WITH_SUITESPARSE="0",
    )
    assert "FFTW" not in result.stderr
    assert "nlopt" not in result.stderr


@pytest.mark.parametrize("apt_get", ["exit 0", "echo 'E: Unable to connect'; exit 100"])
def test_an_installation_that_does_not_help_ends_in_the_same_words(run, bare_path, tree, apt_get):
    """Whatever apt-get does, a missing library is an error, and what apt-get said is shown when it failed."""
    with open(os.path.join(bare_path, "apt-get"), "w") as file:
        file.write(f"#!/bin/sh\n{apt_get}\n")
    os.chmod(file.name, 0o755)
    with open(os.path.join(bare_path, "sudo"), "w") as file:
        file.write('#!/bin/sh\n"$@"\n')
    os.chmod(file.name, 0o755)
    result = run(tree / "tools/setup", cwd=tree, PATH=bare_path, CC="nocc")
    assert result.returncode == 1
    assert "setup: installing gcc" in result.stderr
    assert "error: not found: a C compiler (nocc)" in result.stderr
    assert ("Unable to connect" in result.stderr) == ("Unable" in apt_get)


@pytest.mark.long
def test_second_make_does_nothing_and_other_settings_rebuild(run, tree):
    assert run("make", "-j4", "libs", "CFLAGS=-O0", cwd=tree).returncode == 0  # quick to compile
    again = run("make", "libs", "CFLAGS=-O0", cwd=tree).stdout
    assert again.strip() in ("", "make: Nothing to be done for 'libs'.")
    other = ("make", "-j2", "libs", "CFLAGS=-O0 -g")
    assert "src/core/types.c" in run(*other, cwd=tree).stdout
    (tree / "include/gsid/link.h").touch()
    rebuilt = run(*other, cwd=tree).stdout
    assert "src/core/link.c" in rebuilt
    assert "src/core/lsq.c" not in rebuilt


@pytest.mark.long
def test_the_host_builds_without_its_third_party_libraries(run, tree):
    flags = "CFLAGS=-O1 -Werror"
    built = run("make", "-j4", "libs", "WITH_FFTW=0", "WITH_NLOPT=0", "WITH_SUITESPARSE=0", flags, cwd=tree)
    assert built.returncode == 0, built.stderr
    needed = subprocess.run(
        ["nm", "-u", tree / "build/libgsid_host.a"], check=True, capture_output=True, text=True
    ).stdout
    assert "fftw" not in needed
    assert "nlopt" not in needed
    assert "cholmod" not in needed


def test_help_lists_the_targets(run):
    listed = run("make", "-s", "help").stdout
    for target in ("demo", "test", "lint", "sanitize", "valgrind"):
        assert f"  {target}  " in listed
