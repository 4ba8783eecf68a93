"""Write the C source of one of the two cffi extension modules.

    gsid_build.py 64|32 OUTPUT.c

The declarations come out of the public headers through the C preprocessor, so that there is no second
copy of them. `_gsid64` is the core and the host library in double precision, `_gsid32` the core in single.

For pip and `python -m build` the class BuildModules compiles them with all sources. WITH_FFTW, WITH_NLOPT and
WITH_SUITESPARSE are 0 or 1, as for make. By default NLopt is used where its header is found, and the other
two are left out, because they are under the GPL.
"""

import os
import re
import shlex
import subprocess
import sys
import tempfile
from pathlib import Path

from setuptools.command.build_ext import build_ext

ROOT = Path(__file__).resolve().parent.parent
INCLUDE = ROOT / "include"
UMBRELLA = {"64": "gsid/host.h", "32": "gsid/gsid.h"}
VERSION = re.search(r'#define GSID_VERSION "(.*)"', (INCLUDE / "gsid/types.h").read_text())[1]


# Written in Python (python/gsid/_lib.py): transforms for builds without FFTW, and the threads of a fit.
CALLBACKS = """
extern "Python" void gsid_python_to_lines(uint32_t, const double *, gsid_cplx *);
extern "Python" void gsid_python_to_samples(uint32_t, const gsid_cplx *, double *);
extern "Python" int gsid_python_each(void *, uint32_t, void (*)(void *, uint32_t), void *);
"""


def preprocess(header: str, precision: str, *options: str) -> str:
    """Return `header` after the C preprocessor, without anything of the system's headers."""
    single = ["-DGSID_SINGLE="] if precision == "32" else []
    with tempfile.TemporaryDirectory() as stand_ins:
        for name in ("stddef.h", "stdint.h"):  # cffi knows size_t and uint32_t by itself
            Path(stand_ins, name).touch()
        command = [
            *shlex.split(os.environ.get("CC", "cc")),
            *("-E", "-P", *options, "-nostdinc", f"-I{stand_ins}", f"-I{INCLUDE}"),
            *("-DGSID_PLAIN_NAMES=", *single, str(INCLUDE / header)),
        ]
        return subprocess.run(command, check=True, capture_output=True, text=True).stdout


def constants(header: str, precision: str) -> str:
    """Declare the constant macros by their kind; the compiler fills in the values."""

    def declaration(name: str, value: str) -> str:
        if value.startswith('"'):
            return f"static char *const {name};"
        return f"static const double {name};" if "." in value else f"#define {name} ..."

    macros = preprocess(header, precision, "-dM")
    found = re.findall(r"^#define (GSID_\w+) (\S.*)$", macros, re.MULTILINE)
    return "\n".join(declaration(name, value) for name, value in found)


def main(precision: str, output: str) -> None:
    """Write the C source of the module of this precision to `output`."""
    from cffi import FFI

    header = UMBRELLA[precision]
    ffi = FFI()
    ffi.cdef(preprocess(header, precision) + constants(header, precision))
    if precision == "64":
        ffi.cdef(CALLBACKS)
    define = "#define GSID_SINGLE\n" if precision == "32" else ""
    ffi.set_source(f"gsid._gsid{precision}", f'{define}#include "{header}"\n')
    ffi.emit_c_code(output)


LIBRARIES = {
    "FFTW": ("fftw3.h", "0", ["fftw3", "pthread"]),
    "NLOPT": ("nlopt.h", None, ["nlopt"]),
    "SUITESPARSE": ("suitesparse/SuiteSparseQR_C.h", "0", ["spqr", "cholmod", "suitesparseconfig"]),
}


def has_header(name: str) -> bool:
    """Whether the C compiler finds a header of the system."""
    command = [
        *shlex.split(os.environ.get("CC", "cc")),
        *shlex.split(os.environ.get("CFLAGS", "")),
        "-E",
        "-",
    ]
    text = f"#include <{name}>\n"
    return subprocess.run(command, input=text, capture_output=True, text=True).returncode == 0


def sources(*patterns: str) -> list[str]:
    return sorted(str(path.relative_to(ROOT)) for pattern in patterns for path in ROOT.glob(pattern))


class BuildModules(build_ext):
    """Compile the modules with the C sources, for pip; not where make has compiled them."""

    def finalize_options(self) -> None:
        super().finalize_options()
        for extension in self.extensions:
            folders = ["core", "effects"] + ["host"] * extension.name.endswith("64")
            extension.sources = sources(*(f"src/{folder}/*.c" for folder in folders))
            extension.depends = ["python/gsid_build.py", *sources("include/**/*.h", "src/**/*.[ch]")]
            extension.include_dirs = ["include"]
            if sys.platform != "win32":
                extension.extra_compile_args = ["-std=c99", "-O2", "-g0", "-ffp-contract=off"]

    def run(self) -> None:
        if os.environ.get("GSID_MODULES_OF_MAKE") != "1":
            super().run()

    def build_extension(self, extension) -> None:
        if extension.name.endswith("64"):
            self._add_libraries(extension)
        else:
            extension.define_macros += [("GSID_SINGLE", None)]
        Path(self.build_temp).mkdir(parents=True, exist_ok=True)
        generated = Path(self.build_temp) / f"{extension.name.rpartition('.')[2]}.c"
        main(extension.name[-2:], str(generated))
        extension.sources = [*extension.sources, str(generated)]
        # The same sources are compiled in both precisions.
        shared, self.build_temp = self.build_temp, str(Path(self.build_temp) / extension.name[-2:])
        super().build_extension(extension)
        self.build_temp = shared

    def _add_libraries(self, extension) -> None:
        for name, (header, default, names) in LIBRARIES.items():
            wanted = os.environ.get(f"WITH_{name}", default)
            if wanted is None:
                wanted = str(int(has_header(header)))
                print(
                    f"gsid: {name} is {'used' if wanted == '1' else 'left out: no ' + header}",
                    file=sys.stderr,
                )
            if wanted == "1":
                extension.define_macros += [(f"GSID_WITH_{name}", None)]
                extension.sources += sources(f"src/host/backend/{name.lower()}*.c")
                extension.include_dirs += [
                    str(Path(prefix, "include/suitesparse")) for prefix in ("/usr", "/usr/local")
                ]
                extension.libraries += names


if __name__ == "__main__":
    if len(sys.argv) != 3 or sys.argv[1] not in UMBRELLA:
        sys.exit(__doc__)
    main(*sys.argv[1:])
