"""`gcs` as a process of its own, with the tests' tracker in place of the network: the rest is the product."""

from __future__ import annotations

import sys

import gcs.app
import gcs.demo
from gcs.cli.entry import main
from tests.gcs.blob_tracker import BlobTracker

if __name__ == "__main__":
    gcs.app.make_tracker = gcs.demo.make_tracker = lambda config, say: BlobTracker()
    sys.exit(main(sys.argv[1:]))
