"""Run the command line with ``python -m debrisgrasp``."""

import sys

from debrisgrasp.cli import main

sys.exit(main())
