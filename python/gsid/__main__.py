"""`python -m gsid`: the command where its script is in no folder of PATH."""

import sys

from gsid.cli.main import main

if __name__ == "__main__":
    sys.exit(main())
