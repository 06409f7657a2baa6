"""`python -m gcs.cli`."""

import sys

from gcs.cli.entry import main

sys.exit(main())
