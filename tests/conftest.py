"""Lets tests import the modules that stand beside them (`shapes`, `high_precision`)."""

import os
import sys
from pathlib import Path

# As the command does, before numpy is imported.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).parent))
