"""The command line: ``python -m fmu_didim.cli``."""

import sys

from fmu_didim.cli.main import main

if __name__ == "__main__":
    sys.exit(main())
