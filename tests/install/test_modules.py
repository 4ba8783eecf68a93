"""Zephyr, PlatformIO and ESP-IDF find gsid: their tools read the files, and the sources build so."""

import json
import re
import tarfile

import pytest
from projects import ROOT, cmake_project, require, run

TOOLS = ROOT / "build/install-tools/bin"
VERSION = re.search(r'GSID_VERSION "(.*)"', (ROOT / "include/gsid/types.h").read_text())[1]
pytestmark = pytest.mark.xdist_group("installed")


def tool(name: str) -> str:
    """Return the path of a program of `make test-install`, or skip."""
    if not (TOOLS / name).exists():
        pytest.skip(f"no {name}: `make test-install` installs it")
    return str(TOOLS / name)


@pytest.mark.parametrize(("single", "bytes_"), [("ON", 4), ("OFF", 8)])
def test_zephyr_builds_its_module(tmp_path, single, bytes_):
    require("cmake")
    cmake_project("zephyr_app", tmp_path, f"-DGSID_CLONE={ROOT}", f"-DCONFIG_GSID_SINGLE={single}")
    assert f"{bytes_} bytes" in run(tmp_path / "lowpass").stdout


@pytest.mark.parametrize(("fpu", "single"), [("y", "n"), ("n", "y")])
def test_kconfig_chooses_the_precision_of_the_processor(tmp_path, fpu, single):
    (tmp_path / "Kconfig").write_text(
        f"config CPU_HAS_FPU_DOUBLE_PRECISION\n\tdef_bool {fpu}\nconfig MINIMAL_LIBC\n\tbool\n"
        f'source "{ROOT}/zephyr/Kconfig"\n'
    )
    code = (
        f"import kconfiglib; k = kconfiglib.Kconfig({str(tmp_path / 'Kconfig')!r});"
        "k.syms['GSID'].set_value(2);"
        "print(k.syms['GSID'].str_value, k.syms['GSID_SINGLE'].str_value, *k.warnings)"
    )
    assert run(tool("python"), "-c", code).stdout.split() == ["y", single]


def test_zephyr_finds_the_paths_of_the_module():
    named = dict(
        re.findall(r"^  (cmake|kconfig): (.*)$", (ROOT / "zephyr/module.yml").read_text(), re.MULTILINE)
    )
    assert (ROOT / named["cmake"] / "CMakeLists.txt").is_file()
    assert (ROOT / named["kconfig"]).is_file()


def test_platformio_packs_the_library_and_its_sources_build(tmp_path):
    """The package that PlatformIO itself makes, built as its manifest states."""
    code = (  # its list of licences would come from a network
        "from platformio.package.manifest.schema import ManifestSchema;"
        "from platformio.package.pack import PackagePacker;"
        "ManifestSchema.load_spdx_licenses = staticmethod(lambda: {'licenses': [{'licenseId': 'MIT'}]});"
        f"PackagePacker({str(ROOT)!r}).pack({str(tmp_path / 'gsid.tar.gz')!r})"
    )
    run(tool("python"), "-c", code, HOME=str(tmp_path), PLATFORMIO_CORE_DIR=str(tmp_path / "pio"))
    with tarfile.open(tmp_path / "gsid.tar.gz") as package:
        package.extractall(tmp_path / "package")
    package = tmp_path / "package"
    assert not (package / "python").exists()
    build = json.loads((package / "library.json").read_text())["build"]
    patterns = [entry.removeprefix("+<").removesuffix(">") for entry in build["srcFilter"]]
    sources = [path for pattern in patterns for path in (package / build["srcDir"]).glob(pattern)]
    assert len(sources) > 50
    flags = ["-DGSID_SINGLE", build["flags"], f"-I{package / build['includeDir']}"]
    user = ROOT / "tests/install/lowpass.c"
    run("cc", "-std=gnu99", *flags, "-o", tmp_path / "lowpass", user, *sources, "-lm")
    assert "4 bytes" in run(tmp_path / "lowpass").stdout


def test_esp_idf_builds_its_component(tmp_path):
    require("cmake")
    cmake_project("esp_idf_app", tmp_path, f"-DGSID_CLONE={ROOT}")
    assert "4 bytes" in run(tmp_path / "lowpass_single").stdout


def test_the_component_manager_reads_the_manifest():
    code = (
        "from idf_component_tools.manager import ManifestManager;"
        f"m = ManifestManager({str(ROOT)!r}, 'gsid').load(); print(m.version, m.license, *m.dependencies)"
    )
    printed = run(tool("python"), "-c", code).stdout
    assert printed.split()[:2] == [VERSION, "MIT"]


def test_all_manifests_have_the_version_of_the_header():
    assert json.loads((ROOT / "library.json").read_text())["version"] == VERSION
    assert f'version: "{VERSION}"' in (ROOT / "idf_component.yml").read_text()
    assert f"version: {VERSION}\n" in (ROOT / "CITATION.cff").read_text()
