"""Run every machine-checkable promise of the project and print asked, reached, pass.

Usage: python benchmarks/verify [GROUP ...]. Ends in 1 when a promise fails.
"""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path

# As the command does, before numpy is imported.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(0, str(Path(__file__).parents[2] / "tests"))

import files
import office
import optimiser
import spine
import study
import theory
from table import show

GROUPS = {
    "spine": spine.groups,
    "files": files.groups,
    "office": office.groups,
    "study": study.groups,
    "theory": theory.groups,
    "optimiser": optimiser.groups,
}


def main(wanted: list[str]) -> int:
    """Run the groups wanted, all by default."""
    began, good = time.perf_counter(), True
    for name, groups in GROUPS.items():
        for title, check in groups.items():
            if wanted and name not in wanted and title not in wanted:
                continue
            good &= show(f"{name}: {title}", check())
    print(
        f"\n{'every promise holds' if good else 'a promise FAILS'}"
        f" ({time.perf_counter() - began:.0f} s)"
    )
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
