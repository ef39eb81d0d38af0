"""The scalp layer: skin under hair in the colour of the hair."""

from __future__ import annotations

from collections.abc import Sequence

import torch

from dynhair.avatar import ScalpLayer
from dynhair.editing import HairLook


def roots() -> torch.Tensor:
    return torch.tensor([[0.0, 0, 0], [0.004, 0, 0], [0.05, 0, 0], [0.06, 0, 0], [0.07, 0, 0]])


def look(ids: Sequence[int] = range(5), nearest: Sequence[int] = range(5)) -> HairLook:
    segments = 6 * len(ids)
    harmonics = torch.zeros(1, 3, segments), torch.zeros(15, 3, segments)
    return HairLook(torch.tensor(ids), torch.tensor(nearest), torch.ones(len(ids)), *harmonics)


def test_skin_at_a_root_is_that_strands_colour_and_bare_skin_is_bare() -> None:
    means = torch.tensor([[9.0, 9, 9], [0.0, 0, 0], [0.0, 0.04, 0], [0.002, 0, 0]])
    layer = ScalpLayer.under(roots(), means, torch.tensor([1, 2, 3]))
    colours = torch.rand(2, 5, 6, 3)
    rows, cover, seen = layer(colours.flatten(1, 2), look())
    assert rows.tolist() == [1, 2, 3]
    near_root = colours[:, :, :4].mean(2)
    torch.testing.assert_close(seen[:, 0], near_root[:, 0], atol=0.05, rtol=0)
    torch.testing.assert_close(seen[:, 2], (near_root[:, 0] + near_root[:, 1]) / 2, atol=0.07, rtol=0)
    assert cover[0] > 0.9
    assert cover[2] > 0.9
    assert cover[1] < 0.05


def test_shares_fall_with_distance_and_sum_to_one() -> None:
    layer = ScalpLayer.under(roots(), torch.tensor([[0.052, 0, 0]]), torch.tensor([0]))
    assert layer.strands[0].tolist()[:2] == [2, 3]
    torch.testing.assert_close(layer.shares.sum(1), torch.ones(1))
    distances = (roots()[layer.strands[0]] - torch.tensor([0.052, 0, 0])).norm(dim=1)
    torch.testing.assert_close(layer.shares[0], (1 / distances) / (1 / distances).sum())


def test_the_hair_is_not_coloured_by_the_skin() -> None:
    layer = ScalpLayer.under(roots(), torch.zeros(3, 3), torch.arange(3))
    colours = torch.rand(1, 10, 3, requires_grad=True)
    _, cover, seen = layer(colours, look())
    (seen.sum() * cover.sum()).backward()
    assert colours.grad is None or not colours.grad.any()
    assert layer.cover_logits.grad is not None
    assert layer.cover_logits.grad.all()


def test_skin_under_missing_strands_has_the_colour_of_those_left_nearby() -> None:
    layer = ScalpLayer.under(roots(), torch.tensor([[0.0, 0, 0], [0.065, 0, 0]]), torch.arange(2))
    colours = torch.rand(1, 5, 6, 3)
    whole = layer(colours.flatten(1, 2), look())
    thinned = layer(colours[:, [1, 4]].flatten(1, 2), look([1, 4], [0, 0, 1, 1, 1]))
    assert torch.equal(thinned.cover, whole.cover)
    stand_ins = colours[:, [1, 1, 4, 4, 4]]
    torch.testing.assert_close(thinned.colours, layer(stand_ins.flatten(1, 2), look()).colours)


def test_a_layer_over_nothing_and_of_few_strands() -> None:
    rows, _, colours = ScalpLayer.blank(0)(torch.rand(2, 10, 3), look())
    assert len(rows) == 0
    assert colours.shape == (2, 0, 3)
    few = ScalpLayer.under(roots()[:1], torch.zeros(2, 3), torch.arange(2))
    assert few.strands.shape == (2, 1)
    blank = ScalpLayer.blank(2, 1)
    blank.load_state_dict(few.state_dict())
