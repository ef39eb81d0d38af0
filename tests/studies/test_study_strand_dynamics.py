"""Fits of strand dynamics: that they can be repeated, that they learn, and that what is taught carries over."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from made_motions import made_motion
from studies.hair_motion import strand_dynamics
from studies.hair_motion.fitting import fitted, score
from studies.hair_motion.recordings import Recorded
from studies.hair_motion.strand_dynamics import WINDOW, Dynamics, fit, head_motions

from dynhair.avatar.strand_dynamics import StrandDynamics

SMALL = Dynamics(hidden=24, noise=0.01)


@pytest.mark.parametrize("row", [SMALL, replace(SMALL, mirror=False, noise=0.0)])
def test_a_fit_can_be_repeated(row: Dynamics) -> None:
    motion = made_motion("turn")
    first, second = (fitted(row, [motion], seed=4, steps=3)(motion) for _ in range(2))
    torch.testing.assert_close(first, second, rtol=0, atol=0)
    assert not torch.equal(first, fitted(row, [motion], seed=5, steps=3)(motion))
    assert first.shape == motion.displacements.shape


@pytest.mark.slow
def test_strands_learn_how_strands_move() -> None:
    row, learned = Dynamics(hidden=64, noise=0.01), [made_motion("turn"), made_motion("random1")]
    assert abs(score(fitted(row, learned, steps=0), learned)) < 0.1
    assert score(fitted(row, learned, steps=150), learned) > 0.4


def test_half_of_what_is_learned_beside_other_hair_is_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    own, other = [made_motion("turn"), made_motion("nod")], [made_motion(f"random{number}") for number in range(1, 8)]
    few = [replace(each, canonical=each.canonical[:1], displacements=each.displacements[:, :1]) for each in other]
    learned: list[Recorded] = []
    monkeypatch.setattr(strand_dynamics, "fit", lambda network, motions, *rest: learned.extend(motions))
    fitted(replace(SMALL, beside=True), own, steps=0, others=few)
    assert len(learned) == 2 * (len(few) + 4 * len(own))  # mirrored, too
    assert sum(each.name in ("turn", "nod") for each in learned) == 2 * 4 * len(own)
    monkeypatch.undo()
    assert fitted(replace(SMALL, beside=True), own, steps=3, others=few)(own[0]).shape == own[0].displacements.shape


def test_motions_of_different_lengths_and_hair_teach_together() -> None:
    short, long = made_motion("turn"), made_motion("random1")
    other = replace(long, canonical=1.1 * long.canonical)
    cut = _first(short, 40)
    torch.manual_seed(0)
    network = StrandDynamics(short.canonical.shape[1], 16, short.canonical.mean((0, 1)))
    told: list[int] = []
    fit(network, [cut, long, other], 12, 1e-3, 0.0, told.append)
    assert told == list(range(1, 13))
    with torch.no_grad():
        moved = network(long.canonical[None], head_motions([long]))
    assert moved.abs().max() > 0
    assert len(cut.displacements) > WINDOW


def _first(motion: Recorded, frames: int) -> Recorded:
    """The beginning of a motion."""
    signals = replace(motion.signals, **{name: value[:frames] for name, value in vars(motion.signals).items()})
    return replace(motion, displacements=motion.displacements[:frames], signals=signals)
