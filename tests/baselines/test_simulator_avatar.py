"""An avatar with simulated hair: posing, caching, storing."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from simulated_heads import haired_avatar, head_surface, nodding

from dynhair.baselines import open_driven_head
from dynhair.baselines import simulator as module
from dynhair.baselines.cables import CableParameters, Cables
from dynhair.baselines.simulator import HeadSurface, SimulatedAvatar
from dynhair.baselines.simulator_motion import RigidMotion
from dynhair.capture import Capture
from dynhair.errors import DynhairError
from synthetic import write_synthetic_capture


class StiffCables:
    """Cables that only follow the head, a hand's breadth to the side in each later frame."""

    simulations = 0

    def __init__(self, rest: np.ndarray, *_: object) -> None:
        self.rest = rest

    def simulate(self, motions: Sequence[RigidMotion]) -> Iterator[np.ndarray]:
        StiffCables.simulations += 1
        for frame in range(motions[0].frames):
            rotation, translation = motions[0](frame / motions[0].fps)
            moved = self.rest + frame * np.array([0.1, 0.0, 0.0])
            yield rotation.apply(moved.reshape(-1, 3)).reshape(moved.shape) + translation


@pytest.fixture
def simulated(monkeypatch: pytest.MonkeyPatch) -> SimulatedAvatar:
    monkeypatch.setattr(module, "Cables", StiffCables)
    StiffCables.simulations = 0
    return SimulatedAvatar(haired_avatar(), head_surface(), guides=6)


def test_the_hair_follows_its_guides_in_the_head_frame(simulated: SimulatedAvatar) -> None:
    track = nodding()
    posed = simulated.pose(track, 3)
    rotation = torch.from_numpy(track.rotations[3]).float()
    in_head = (posed.strands - torch.from_numpy(track.translations[3]).float()) @ rotation
    moved = in_head - simulated.avatar.canonical_strands
    torch.testing.assert_close(moved, torch.tensor([0.3, 0.0, 0.0]).expand_as(moved), atol=1e-5, rtol=0.0)
    own = simulated.avatar.pose(track, 3)
    assert torch.equal(posed.head.means, own.head.means)


def test_rigid_hair_is_the_avatars(simulated: SimulatedAvatar) -> None:
    rigid = simulated.pose(nodding(), 2, rigid_hair=True)
    assert torch.equal(rigid.strands, simulated.avatar.pose(nodding(), 2, rigid_hair=True).strands)
    assert StiffCables.simulations == 0


def test_a_track_is_simulated_once_and_few_are_kept(simulated: SimulatedAvatar) -> None:
    first = nodding()
    for frame in (2, 0, 1):
        simulated.pose(first, frame)
    simulated.pose(nodding(), 0)  # an equal track
    assert StiffCables.simulations == 1
    for shift in range(module.TRACKS_KEPT):
        simulated.pose(replace(first, translations=first.translations + 1.0 + shift), 0)
    assert StiffCables.simulations == 1 + module.TRACKS_KEPT
    simulated.pose(first, 0)
    assert StiffCables.simulations == 2 + module.TRACKS_KEPT


def test_a_saved_avatar_moves_alike(simulated: SimulatedAvatar, tmp_path: Path) -> None:
    simulated.parameters = replace(CableParameters(), drag=7.0)
    simulated.save(tmp_path / "avatar")
    again = open_driven_head(tmp_path / "avatar")
    assert isinstance(again, SimulatedAvatar)
    assert (again.parameters, again.guides) == (simulated.parameters, 6)
    assert torch.equal(again.pose(nodding(), 1).strands, simulated.pose(nodding(), 1).strands)


def test_damaged_folders_are_refused(simulated: SimulatedAvatar, tmp_path: Path) -> None:
    path = tmp_path / "avatar"
    with pytest.raises(DynhairError, match="no such folder"):
        SimulatedAvatar.load(path)
    simulated.save(path)
    description = json.loads((path / "avatar.json").read_text())
    (path / "avatar.json").write_text(json.dumps({**description, "parameters": {"colour": 1.0}}))
    with pytest.raises(DynhairError, match="damaged"):
        SimulatedAvatar.load(path)
    (path / "avatar.json").write_text(json.dumps({**description, "version": 99}))
    with pytest.raises(DynhairError, match="version 99"):
        SimulatedAvatar.load(path)
    (path / "avatar.json").write_text(json.dumps(description))
    (path / "avatar.safetensors").unlink()
    with pytest.raises(DynhairError, match="missing"):
        SimulatedAvatar.load(path)


def test_the_surface_is_the_captures_in_two_parts(tmp_path: Path) -> None:
    capture = Capture.open(write_synthetic_capture(tmp_path / "capture", frames=2, views=1, size=16))
    surface = HeadSurface.tracked(capture)
    head, body = surface.parts()
    assert len(head.faces) + len(body.faces) == len(surface.faces)  # nothing there follows both
    assert np.linalg.norm(head.vertices[head.faces], axis=-1).max() < 0.1
    assert body.vertices[body.faces][..., 1].max() < -0.1
    blended = replace(surface, follow=torch.full_like(surface.follow, 0.5))
    assert all(len(part.faces) == len(surface.faces) for part in blended.parts())


@pytest.mark.slow
def test_simulated_hair_falls_and_swings() -> None:
    assert module.Cables is Cables
    simulated = SimulatedAvatar(
        haired_avatar(), head_surface(), replace(CableParameters(), young=4e7, attraction=0.0), guides=6
    )
    moved = simulated.displacements(nodding())
    assert moved.isfinite().all()
    torch.testing.assert_close(moved[:, :, :2], torch.zeros_like(moved[:, :, :2]), atol=1e-4, rtol=0.0)
    assert moved[0, :, -1, 1].mean() < -0.01  # the tips have fallen
    assert (moved[-1] - moved[0]).norm(dim=-1).max() > 0.01
