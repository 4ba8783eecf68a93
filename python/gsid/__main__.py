"""`python -m gsid` runs the command where the script `gsid` is not on PATH."""

import sys

from gsid.cli.main import main

if __name__ == "__main__":
    sys.exit(main())
