"""Lets tests import the modules that stand beside them (`shapes`, `high_precision`)."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
