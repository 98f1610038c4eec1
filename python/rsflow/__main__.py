"""``python -m rsflow``: the command line."""

import sys

from rsflow.cli import main

sys.exit(main())
