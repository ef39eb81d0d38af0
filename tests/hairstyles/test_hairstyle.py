"""Strands of every family on random heads."""

from __future__ import annotations

import pytest
import torch

from dynhair.errors import DynhairError
from dynhair.hairstyles import FAMILIES, HeadField, grow_hairstyle, random_head, random_style
from dynhair.strands import MeshDistance, sample_roots, segment_lengths
from dynhair.strands.scalp import smooth_surface
from dynhair.strands.scalp_map import ScalpFrame

_COUNT = 80


@pytest.fixture(scope="module")
def head():
    vertices, faces, scalp = random_head(3)
    roots = smooth_surface(sample_roots(vertices, faces, scalp, _COUNT, 0), vertices, faces)
    frame = ScalpFrame.of(vertices, faces, scalp)
    return roots, frame, HeadField.of(vertices, faces), MeshDistance(vertices, faces)


@pytest.mark.parametrize("family", FAMILIES)
def test_strands_start_at_their_roots_do_not_stretch_and_stay_outside(head, family):
    (positions, normals), frame, field, mesh = head
    strands = grow_hairstyle(random_style(family, 5), positions, normals, frame, field)
    assert strands.shape == (_COUNT, 64, 3)
    torch.testing.assert_close(strands[:, 0], positions)
    lengths = segment_lengths(strands)
    assert bool((lengths > 0).all())
    torch.testing.assert_close(lengths, lengths.mean(1, keepdim=True).expand_as(lengths), rtol=0.01, atol=0)
    distance, _ = mesh.query(strands[:, 1:].flatten(0, 1))
    assert distance.min() > -5e-4


@pytest.mark.parametrize("family", ["long_wavy_middle", "ponytail_low", "coily_short"])
def test_a_strand_does_not_depend_on_the_other_roots(head, family):
    (positions, normals), frame, field, _ = head
    style = random_style(family, 1)
    strands = grow_hairstyle(style, positions, normals, frame, field, 20)
    some = torch.arange(0, _COUNT, 7)
    alone = grow_hairstyle(style, positions[some], normals[some], frame, field, 20)
    torch.testing.assert_close(alone, strands[some], rtol=0, atol=1e-5)


def test_a_strand_needs_three_points(head):
    (positions, normals), frame, field, _ = head
    with pytest.raises(DynhairError, match="no shape"):
        grow_hairstyle(random_style("cropped", 0), positions, normals, frame, field, 2)
