"""gsid.c and gsid.h compile everywhere, compute the same, and are no larger than the library."""

import re
from pathlib import Path

import pytest
from projects import ROOT, require, run

ARM = (
    "-mcpu=cortex-m7",
    "-mthumb",
    "-mfpu=fpv5-sp-d16",
    "-mfloat-abi=hard",
    "--specs=nano.specs",
    "--specs=nosys.specs",
)
C99 = ("-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror")
CPP = ("-x", "c++", "-std=c++20", "-Wall", "-Wextra", "-Wno-missing-field-initializers", "-Werror")
COMPILERS = {
    "gcc": ("gcc", *C99),
    "clang": ("clang", *C99, "-Wno-missing-field-initializers"),
    "arm": ("arm-none-eabi-gcc", *C99, *ARM[:4]),
    "g++": ("g++", *CPP),
    "clang++": ("clang++", *CPP, "-Wno-c99-extensions"),
}
PRECISIONS = {"double": (), "float": ("-DGSID_SINGLE",)}
LARGER_MOST = 0.02  # all of core and effects
LARGER_MOST_PART = (
    0.12  # a program that uses a part: the compiler shares small functions among all callers in a file
)


@pytest.fixture(scope="session")
def two_files(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("amalgamation")
    run("make", "amalgamation", f"BUILD={folder}")
    return folder / "amalgamation"


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("compiler", COMPILERS)
def test_it_compiles_without_warnings(two_files, tmp_path, compiler, precision):
    command = COMPILERS[compiler]
    require(command[0])
    flags = (*PRECISIONS[precision], "-ffp-contract=off", "-O1")
    run(*command, *flags, "-c", "-o", tmp_path / "gsid.o", two_files / "gsid.c")
    defined = run("nm", "-g", "--defined-only", tmp_path / "gsid.o").stdout
    assert re.search(r"[TR] gsid_frf_step_f" + ("32" if precision == "float" else "64"), defined)
    assert not re.search(r" [A-Z] (?!_?gsid_)", defined)  # as C++ too the names are those of C


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("compiler", ["gcc", "g++"])
def test_a_program_of_two_files_runs(two_files, tmp_path, compiler, precision):
    for name in ("gsid.c", "gsid.h"):
        (tmp_path / name).write_text((two_files / name).read_text())
    user = (ROOT / "tests/install/lowpass.c").read_text().replace("<gsid/gsid.h>", '"gsid.h"')
    (tmp_path / "lowpass.c").write_text(user)
    language = ("-x", "c++", "-std=c++20") if compiler == "g++" else ("-std=c99",)
    sources = (tmp_path / "gsid.c", tmp_path / "lowpass.c")
    run(compiler, *language, *PRECISIONS[precision], "-o", tmp_path / "lowpass", *sources, "-lm")
    assert "0.5000 -0.5000j" in run(tmp_path / "lowpass").stdout


def functions() -> list[str]:
    """Names of all public functions of the core."""
    pattern = r"^[\w ]+?[ *](gsid_\w+)\([^;{]*\);"
    texts = (path.read_text() for path in (ROOT / "include/gsid").glob("*.h"))
    text = re.sub(r"/\*.*?\*/", "", "\n".join(texts), flags=re.DOTALL)
    return sorted(set(re.findall(pattern, text, flags=re.MULTILINE)))


def program(names: list[str]) -> str:
    uses = ", ".join(f"(use){name}" for name in names)
    return (
        '#include "gsid/gsid.h"\n#include "gsid/effect_facts.h"\ntypedef void (*use)(void);\n'
        f"use uses[] = {{{uses}}};\nint main(void) {{ for (;;) {{ uses[0](); }} }}\n"
    )


PROGRAMS = {
    "everything": functions(),
    "measurement": [
        "gsid_frf_init",
        "gsid_frf_step",
        "gsid_frf_skip",
        "gsid_frf_result",
        "gsid_multisine_step",
    ],
    "fit": ["gsid_rational_init", "gsid_estimate_iwls", "gsid_estimate_ml"],
    "plant": ["gsid_plant_mem_size", "gsid_plant_init", "gsid_plant_step", "gsid_catalogue_find"],
}


SMALL = (
    "-std=c99",
    "-Os",
    "-ffp-contract=off",
    "-ffunction-sections",
    "-fdata-sections",
    "-DGSID_SINGLE",
)


@pytest.fixture(scope="module", params=["gcc", "arm"])
def objects(request, two_files, tmp_path_factory):
    """The compiler, and the objects of the library and of the two files, compiled once for all programs."""
    command = ("gcc",) if request.param == "gcc" else ("arm-none-eabi-gcc", *ARM)
    require(command[0])
    folder = tmp_path_factory.mktemp("objects")
    sources = [path for layer in ("core", "effects") for path in (ROOT / "src" / layer).glob("*.c")]
    objects_of = {"none": []}
    for name, files in {"library": sources, "two files": [two_files / "gsid.c"]}.items():
        objects_of[name] = [folder / f"{name}_{path.stem}.o".replace(" ", "_") for path in files]
        for path, compiled in zip(files, objects_of[name], strict=True):
            run(*command, *SMALL, f"-I{ROOT / 'include'}", "-c", "-o", compiled, path)
    return request.param, (*command, *SMALL, f"-I{ROOT / 'include'}"), objects_of


@pytest.mark.long
@pytest.mark.xdist_group("objects")
@pytest.mark.parametrize("used", PROGRAMS)
def test_a_program_is_not_much_larger_than_with_the_library(objects, tmp_path, used):
    """Code and constants of the linked program, sections collected, in single precision."""
    compiler, command, objects_of = objects
    (tmp_path / "main.c").write_text(program(PROGRAMS[used]))
    (tmp_path / "empty.c").write_text("int main(void) { for (;;) { } }\n")
    bytes_of = {}
    for name, compiled in objects_of.items():
        main = tmp_path / ("main.c" if compiled else "empty.c")
        elf = tmp_path / f"{name}.elf".replace(" ", "_")
        run(*command, "-Wl,--gc-sections", "-o", elf, main, *compiled, "-lm")
        text, data = run("size", elf).stdout.splitlines()[1].split()[:2]
        bytes_of[name] = int(text) + int(data)
    own = {name: size - bytes_of["none"] for name, size in bytes_of.items()}
    larger = own["two files"] / own["library"] - 1
    print(f"{used}, {compiler}: {own['library']} bytes, as two files {100 * larger:+.1f} %")
    assert own["library"] > 1000
    assert larger <= (LARGER_MOST if used == "everything" else LARGER_MOST_PART)
