"""Every row on every groom, from as many motions as asked for; each result is a file, so that a study can go on."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console
from studies.hair_motion.fitting import ROWS, fitted, score, thinned
from studies.hair_motion.grooms import GROOMS
from studies.hair_motion.motions import ELEVEN, LESSONS, MORE, UNSEEN
from studies.hair_motion.recordings import Recorded, explained, recorded
from studies.hair_motion.simulation import simulated
from studies.hair_motion.strand_dynamics import Dynamics

from dynhair.errors import DynhairError
from dynhair.progress import StageProgress
from dynhair.storage import read_json, write_json

LEARNED = (*ELEVEN, *MORE)
"""Motions to learn from, in the order in which they are added."""

DISTURBANCE = 0.0005
"""Metres: two simulations that differ by so little say how much of the motion can be predicted at all."""

DISTURBED = ("stop", "random5")


@dataclass(frozen=True)
class Job:
    """One fit."""

    groom: str
    row: str
    motions: int
    seed: int

    @property
    def file(self) -> str:
        """Name of its result."""
        row = self.row.replace(" ", "_").replace(",", "").replace("=", "")
        return f"{self.groom}-{row}-{self.motions}-{self.seed}.json"


def jobs(grooms: Sequence[str], rows: Sequence[str], counts: Iterable[int], seeds: int) -> list[Job]:
    """All fits that are asked for: eleven motions first, for these are what rows are compared on.

    Raises:
        DynhairError: there is no such groom or row, or not as many motions or seeds.
    """
    for kind, names, known in (("groom", grooms, GROOMS), ("row", rows, ROWS)):
        for name in names:
            if name not in known:
                raise DynhairError(f"no {kind} is called `{name}`", expected=" or ".join(known))
    counts = sorted(counts, key=lambda count: (count != len(ELEVEN), count))
    for count in counts:
        if not 1 <= count <= len(LEARNED):
            raise DynhairError(f"{count} motions to learn from", expected=f"1 to {len(LEARNED)}")
    if seeds < 1:
        raise DynhairError(f"{seeds} seeds", expected="at least one")
    return [
        Job(groom, row, count, seed) for seed in range(seeds) for count in counts for groom in grooms for row in rows
    ]


def simulate_all(folder: Path, work: Sequence[Job], console: Console) -> None:
    """Simulate whatever these fits learn from and are measured on, unless it is there already."""
    wanted: dict[tuple[str, str, float], None] = {}
    for job in work:
        for name in (*UNSEEN, *LEARNED[: job.motions]):
            wanted[job.groom, name, 0.0] = None
        for name in DISTURBED:
            wanted[job.groom, name, DISTURBANCE] = None
        for groom, name in _lessons(job):
            wanted[groom, name, 0.0] = None
    with StageProgress(console).shown() as bars:
        stage = bars.stage("simulating", len(wanted))
        for done, (groom, name, disturbance) in enumerate(wanted, start=1):
            simulated(folder / "simulated", groom, name, disturbance)
            stage.update(done, f"{groom} {name}")


def fit_all(folder: Path, work: Sequence[Job], console: Console) -> None:
    """Fit whatever has no result yet.

    A result says what is explained of the motions that were learned from, of the others that could have been, which
    designs may be compared on, and of each unseen one.
    """
    with StageProgress(console).shown() as bars:
        stage = bars.stage("fitting", len(work))
        for done, job in enumerate(work, start=1):
            path = folder / "results" / job.file
            if not path.exists():
                write_json(path, _result(folder, job))
            stage.update(done, f"{job.groom}, {job.row}")


def ceiling(folder: Path, groom: str) -> dict[str, float]:
    """What one simulation explains of another that begins half a millimetre beside it."""
    found = {}
    for name in DISTURBED:
        path = folder / "simulated" / groom / f"{name}.npz"
        true, beside = recorded(path), recorded(path.with_name(f"{name}-disturbed.npz"))
        found[name] = explained(beside.canonical + beside.displacements - true.canonical, true.displacements)
    return found


def results(folder: Path) -> Iterator[dict[str, object]]:
    """What has been fitted so far."""
    for path in sorted((folder / "results").glob("*.json")):
        yield read_json(path)


def _result(folder: Path, job: Job) -> dict[str, object]:
    row, learned = ROWS[job.row], LEARNED[: job.motions]
    whole = [_recorded(folder, job.groom, name) for name in learned]
    motions = [thinned(motion) for motion in whole]
    beside = [_recorded(folder, groom, name) for groom, name in _lessons(job)]
    started = time.process_time()
    # to dynamics each strand is one more example; a deformer belongs to its strands
    predictor = fitted(row, whole if isinstance(row, Dynamics) else motions, job.seed, others=beside)
    seconds = time.process_time() - started
    held_out = [name for name in MORE if name not in LEARNED[: job.motions]]
    validation = [name for name in held_out if (folder / "simulated" / job.groom / f"{name}.npz").exists()]
    others = _thinned(folder, job.groom, validation)
    unseen = _thinned(folder, job.groom, UNSEEN)
    return {
        "groom": job.groom,
        "row": job.row,
        "motions": job.motions,
        "seed": job.seed,
        "cpu_seconds": round(seconds, 1),
        "learned": score(predictor, motions),
        "validation": score(predictor, others) if others else None,
        "unseen": {motion.name: explained(predictor(motion), motion.displacements) for motion in unseen},
    }


def _lessons(job: Job) -> list[tuple[str, str]]:
    """Groom and motion of all other hair that a fit learns beside."""
    row = ROWS[job.row]
    if not (isinstance(row, Dynamics) and row.beside):
        return []
    return [(groom, name) for groom in GROOMS if groom != job.groom for name in LESSONS]


def _thinned(folder: Path, groom: str, names: Sequence[str]) -> list[Recorded]:
    return [thinned(_recorded(folder, groom, name)) for name in names]


def _recorded(folder: Path, groom: str, name: str) -> Recorded:
    return recorded(folder / "simulated" / groom / f"{name}.npz")
