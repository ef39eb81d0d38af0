"""Regions of a hairstyle."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from dynhair.editing.regions import Box, NamedRegion, Sphere, StrandIds, parse_region
from dynhair.errors import DynhairError

SECTIONS = ("front", "top", "left", "right", "back")


def scalp(count: int = 2000) -> torch.Tensor:
    """Roots all over a scalp-like part of an ellipsoid, off the origin: x to the left, y up, z forwards."""
    generator = torch.Generator().manual_seed(0)
    directions = torch.nn.functional.normalize(torch.randn(4 * count, 3, generator=generator), dim=1)
    hairy = directions[:, 1] > 0.8 * directions[:, 2] - 0.2  # the hairline is higher above the face than at the neck
    return (directions[hairy] * torch.tensor([0.075, 0.08, 0.095]) + torch.tensor([0.0, 0.03, -0.02]))[:count]


def test_every_root_is_in_one_section() -> None:
    roots = scalp()
    counts = sum(parse_region(name).select(roots).long() for name in SECTIONS)
    assert (torch.as_tensor(counts) == 1).all()
    for name in SECTIONS:
        assert parse_region(name).select(roots).float().mean() > 0.05, name
    assert parse_region("all").select(roots).all()


def test_sections_are_where_a_hairdresser_means_them() -> None:
    roots = scalp()
    x, y, z = (roots - torch.tensor([0.0, 0.03, -0.02])).unbind(1)
    mean = {name: torch.stack([x, y, z], 1)[parse_region(name).select(roots)].mean(0) for name in SECTIONS}
    assert mean["left"][0] > 0.03  # the subject's left
    assert mean["right"][0] < -0.03
    assert mean["front"][2] > 0.02
    assert mean["back"][2] < -0.03
    assert max(mean, key=lambda name: float(mean[name][1])) == "top"
    sides = parse_region("sides").select(roots)
    assert torch.equal(sides, parse_region("left").select(roots) | parse_region("right").select(roots))
    assert parse_region("fringe") == parse_region("front") == NamedRegion("front")


def test_sections_of_a_mirrored_scalp_are_mirrored() -> None:
    roots = scalp()
    mirrored = roots * torch.tensor([-1.0, 1.0, 1.0])
    assert torch.equal(parse_region("left").select(roots), parse_region("right").select(mirrored))
    assert torch.equal(parse_region("top").select(roots), parse_region("top").select(mirrored))


@pytest.mark.parametrize("count", [1, 2])
def test_few_roots_have_sections_too(count: int) -> None:
    assert sum(int(parse_region(name).select(scalp(count)).sum()) for name in SECTIONS) == count


def test_boxes_and_spheres_hold_what_lies_in_them() -> None:
    roots = torch.tensor([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.2, 0.0], [0.0, 0.0, -0.3]])
    assert parse_region("box:-0.05,0.2,-1,0.1,-1,1").select(roots).tolist() == [True, True, False, True]
    assert parse_region("sphere:0,0.1,0,0.12").select(roots).tolist() == [True, False, True, False]


def test_ids_are_numbers_ranges_or_a_file(tmp_path: Path) -> None:
    roots = torch.zeros(8, 3)
    assert parse_region("ids:1,5-7").select(roots).nonzero()[:, 0].tolist() == [1, 5, 6, 7]
    path = tmp_path / "strands.txt"
    path.write_text("5 6\n7,1\n")
    assert parse_region(f"ids:{path}") == parse_region("ids:1,5-7")
    assert str(parse_region(f"ids:{path}")) == "ids:1,5-7"
    with pytest.raises(DynhairError, match="no strand 8"):
        parse_region("ids:8").select(roots)


numbers = st.floats(-1e3, 1e3)
pairs = st.tuples(numbers, numbers).map(lambda pair: (min(pair), max(pair)))


@given(
    name=st.sampled_from([*SECTIONS, "sides", "all"]),
    bounds=st.tuples(pairs, pairs, pairs),
    centre=st.tuples(numbers, numbers, numbers),
    radius=st.floats(1e-3, 1e3),
    ids=st.sets(st.integers(0, 500), min_size=1),
)
def test_a_region_is_what_its_string_says(name: str, bounds: Any, centre: Any, radius: float, ids: set[int]) -> None:
    box = Box((*bounds[0], *bounds[1], *bounds[2]))
    for region in (NamedRegion(name), box, Sphere(centre, radius), StrandIds(tuple(sorted(ids)))):
        assert parse_region(str(region)) == region


@pytest.mark.parametrize(
    "text",
    [
        "",
        "nape",
        "left:1",
        "box",
        "box:1,2,3",
        "box:0,1,0,1,0,nan",
        "box:1,0,0,1,0,1",
        "sphere:0,0,0,0",
        "sphere:0,0,0,-1",
        "sphere:a,b,c,d",
        "ids:",
        "ids:5-1",
        "ids:-3",
        "ids:1-",
        "ids:99999999",
        "ids:/nowhere/strands.txt",
    ],
)
def test_what_is_no_region_is_refused(text: str) -> None:
    with pytest.raises(DynhairError, match="expected: "):
        parse_region(text)


def test_a_file_that_holds_no_ids_is_named(tmp_path: Path) -> None:
    path = tmp_path / "strands.txt"
    path.write_text("one two")
    with pytest.raises(DynhairError, match=r"strands\.txt: 'one' is no strand id"):
        parse_region(f"ids:{path}")
    path.write_bytes(b"\xff\xfe")
    with pytest.raises(DynhairError, match=r"strands\.txt"):
        parse_region(f"ids:{path}")
