"""`python -m agents.cli` is the command `wheelchair`."""

import sys

from agents.cli import main

sys.exit(main())
