"""The study, or a part of it: simulate, fit, and say what is explained of unseen motions.

    python -m studies.hair_motion OUT [--grooms long wavy] [--rows "24 modes" ...] [--counts 11 2 4 8 20 40] [--seeds 3]

Needs Blender (`make blender`, or the variable DYNHAIR_BLENDER). What is in OUT already is not made again.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path

os.environ.setdefault("OMP_WAIT_POLICY", "passive")  # before torch starts its threads

import torch
from rich.console import Console
from studies.hair_motion.fitting import ROWS
from studies.hair_motion.grooms import GROOMS, STUDIED
from studies.hair_motion.pages import write_page
from studies.hair_motion.study import fit_all, jobs, simulate_all

from dynhair.errors import DynhairError

COUNTS = (11, 2, 4, 8, 20, 40)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run what is asked for; 2 where that is impossible."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path, help="folder of simulations, results, tables and plots")
    parser.add_argument("--grooms", nargs="+", default=list(STUDIED), metavar="GROOM", help=", ".join(GROOMS))
    parser.add_argument("--rows", nargs="+", default=list(ROWS), metavar="ROW", help="; ".join(ROWS))
    parser.add_argument("--counts", nargs="+", type=int, default=COUNTS, metavar="N", help="motions to learn from")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--threads", type=int, default=1)
    options = parser.parse_args(arguments)
    torch.set_num_threads(options.threads)
    console = Console(stderr=True)
    try:
        work = jobs(options.grooms, options.rows, options.counts, options.seeds)
        simulate_all(options.out, work, console)
        fit_all(options.out, work, console)
        write_page(options.out)
    except DynhairError as error:
        console.print(str(error), style="red", markup=False)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
