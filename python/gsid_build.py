"""Write the C source of one of the two cffi extension modules.

    gsid_build.py 64|32 OUTPUT.c

The declarations come out of the public headers through the C preprocessor, so that there is no second
copy of them. `_gsid64` is the core and the host library in double precision, `_gsid32` the core in single.
"""

import os
import re
import shlex
import subprocess
import sys
import tempfile
from pathlib import Path

INCLUDE = Path(__file__).resolve().parent.parent / "include"
UMBRELLA = {"64": "gsid/host.h", "32": "gsid/gsid.h"}
VERSION = re.search(r'#define GSID_VERSION "(.*)"', (INCLUDE / "gsid/types.h").read_text())[1]


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
    define = "#define GSID_SINGLE\n" if precision == "32" else ""
    ffi.set_source(f"gsid._gsid{precision}", f'{define}#include "{header}"\n')
    ffi.emit_c_code(output)


if __name__ == "__main__":
    if len(sys.argv) != 3 or sys.argv[1] not in UMBRELLA:
        sys.exit(__doc__)
    main(*sys.argv[1:])
