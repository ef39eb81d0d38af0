"""Edits of canonical hair, without an avatar."""

from __future__ import annotations

import json
from dataclasses import FrozenInstanceError, replace
from typing import Any

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from dynhair.avatar.spherical_harmonics import constant_coefficient, harmonics_colours
from dynhair.editing import (
    Brightness,
    CanonicalHair,
    Edit,
    EditedHair,
    HairLook,
    Thin,
    Tint,
    Trim,
    Width,
    edits_from_json,
)
from dynhair.editing.colours import lightness
from dynhair.errors import DynhairError
from dynhair.strands import strand_lengths

STRANDS, POINTS = 40, 17
SEGMENTS = STRANDS * (POINTS - 1)


def curls(seed: int = 0, strands: int = STRANDS) -> torch.Tensor:
    """Helices of different lengths and pitches, unevenly sampled, rooted all over a head of 10 cm."""
    generator = torch.Generator().manual_seed(seed)

    def numbers(*shape: int) -> torch.Tensor:
        return torch.rand(*shape, generator=generator, dtype=torch.float64)

    roots = torch.nn.functional.normalize(numbers(strands, 3) - 0.5, dim=1) * 0.1
    steps = (numbers(strands, POINTS - 1) + 0.2).cumsum(1)
    along = torch.nn.functional.pad(steps / steps[:, -1:], (1, 0))
    angle = along * 3 * numbers(strands, 1)
    length, radius = 0.05 + 0.3 * numbers(strands, 1), 0.02 * numbers(strands, 1)
    helix = torch.stack([radius * (angle.cos() - 1), -length * along, radius * angle.sin()], -1)
    return roots[:, None] + helix


def hair(seed: int = 0, strands: int = STRANDS) -> CanonicalHair:
    generator = torch.Generator().manual_seed(seed)
    segments = strands * (POINTS - 1)
    base = constant_coefficient(0.1 + 0.4 * torch.rand(1, segments, 3, generator=generator).double()).mT
    higher = 0.05 * torch.randn(15, 3, segments, generator=generator).double()
    look = HairLook(torch.arange(strands), torch.arange(strands), torch.full((strands,), 0.001).double(), base, higher)
    return CanonicalHair.of(curls(seed, strands), look)


def seen(look: HairLook, directions: torch.Tensor | None = None) -> torch.Tensor:
    """Colours from a few directions, (v, n, 3)."""
    if directions is None:
        directions = torch.nn.functional.normalize(torch.randn(6, 3, generator=torch.Generator().manual_seed(3)), dim=1)
    count = look.base_harmonic.shape[2]
    return harmonics_colours(
        look.base_harmonic, look.higher_harmonics, directions.to(look.base_harmonic)[:, None].expand(-1, count, 3)
    )


def edited(*edits: Edit, of: CanonicalHair | None = None) -> EditedHair:
    made = hair() if of is None else of
    for edit in edits:
        made = edit.apply(made)
    return EditedHair(made)


EDITS = [
    Brightness(0.7),
    Brightness(1.5, region="left"),
    Tint("#b3202a"),
    Tint((0.1, 0.2, 0.9), 0.5, region="sphere:0,0.1,0,0.08"),
    Trim(0.8, region="left"),
    Trim(longest=0.12),
    Trim(length_of="ids:0-3", region="box:-1,0,-1,1,-1,1"),
    Thin(0.5, region="top"),
    Width(2.0, region="ids:1,3-5"),
]


@pytest.mark.parametrize("edit", EDITS, ids=str)
def test_edits_survive_json(edit: Edit) -> None:
    stored = json.loads(json.dumps([edit.to_json()]))
    assert edits_from_json(stored) == (edit,)
    assert str(edit)
    with pytest.raises(FrozenInstanceError):
        edit.region = "all"  # pyright: ignore[reportAttributeAccessIssue]


def test_whole_numbers_in_json_are_numbers() -> None:
    assert edits_from_json([{"edit": "width", "factor": 2}]) == (Width(2.0),)
    assert edits_from_json([{"edit": "tint", "colour": [1, 0, 0]}]) == (Tint((1.0, 0.0, 0.0)),)


@pytest.mark.parametrize(
    "make",
    [
        lambda: Brightness(0.0),
        lambda: Brightness(float("nan")),
        lambda: Brightness(5.0),
        lambda: Tint("red"),
        lambda: Tint("#12345g"),
        lambda: Tint("0.1,0.2"),
        lambda: Tint("255,0,0"),
        lambda: Tint("#ffffff", 1.5),
        lambda: Tint("#ffffff", -0.1),
        Trim,
        lambda: Trim(0.5, longest=0.1),
        lambda: Trim(1.01),
        lambda: Trim(0.0),
        lambda: Trim(longest=-0.1),
        lambda: Trim(length_of="nowhere"),
        lambda: Thin(0.0),
        lambda: Thin(1.5),
        lambda: Width(-1.0),
        lambda: Width(11.0),
        lambda: Width(1.0, region="nowhere"),
    ],
)
def test_what_is_out_of_range_is_refused(make: Any) -> None:
    with pytest.raises(DynhairError, match="expected: "):
        make()


@pytest.mark.parametrize(
    "stored",
    [
        "brightness",
        {"edit": "width", "factor": 2},
        ["width"],
        [{"factor": 2}],
        [{"edit": "shave"}],
        [{"edit": ["width"]}],
        [{"edit": "width"}],
        [{"edit": "width", "factor": "2"}],
        [{"edit": "width", "factor": True}],
        [{"edit": "width", "factor": 2, "colour": 3}],
        [{"edit": "width", "factor": 2, "region": 3}],
        [{"edit": "tint", "colour": 3}],
        [{"edit": "tint", "colour": [1, 0]}],
    ],
    ids=str,
)
def test_json_that_is_no_edit_is_refused(stored: Any) -> None:
    with pytest.raises(DynhairError):
        edits_from_json(stored)


def test_without_edits_nothing_changes() -> None:
    canonical, made = hair(), edited()
    assert made(canonical.strands) is canonical.strands
    assert made.look.ids.tolist() == list(range(STRANDS))
    assert torch.equal(made.look.base_harmonic, canonical.base_harmonic)
    assert torch.equal(made.look.higher_harmonics, canonical.higher_harmonics)


@given(keep=st.floats(0.05, 1.0), seed=st.integers(0, 9))
def test_trimming_leaves_that_share_of_the_arc_length(keep: float, seed: int) -> None:
    canonical = hair(seed)
    left = edited(Trim(keep), of=canonical)(canonical.strands)
    assert left.shape == canonical.strands.shape
    assert torch.equal(left[:, 0], canonical.strands[:, 0])
    share = strand_lengths(left) / strand_lengths(canonical.strands)
    assert (share <= keep + 1e-9).all()  # a chord is shorter than its arc
    torch.testing.assert_close(share, torch.full_like(share, keep), rtol=0.01, atol=0)
    # all new points lie on the old strands
    start, along = canonical.strands[:, None, :-1], canonical.strands.diff(dim=1)[:, None]
    places = ((left[:, :, None] - start) * along).sum(-1) / along.square().sum(-1)
    gaps = (left[:, :, None] - start - places.clamp(0, 1)[..., None] * along).norm(dim=-1).amin(2)
    assert gaps.max() < 1e-9


@given(first=st.floats(0.1, 1.0), second=st.floats(0.1, 1.0))
def test_trims_multiply(first: float, second: float) -> None:
    canonical = hair()
    twice = edited(Trim(first), Trim(second))(canonical.strands)
    once = edited(Trim(first * second))(canonical.strands)
    torch.testing.assert_close(twice, once, atol=1e-6, rtol=0)


def test_trimming_to_a_length_spares_shorter_strands() -> None:
    canonical = hair()
    before = strand_lengths(canonical.strands)
    left = edited(Trim(longest=0.15))(canonical.strands)
    short = before <= 0.15
    assert 0 < short.sum() < STRANDS
    assert torch.equal(left[short], canonical.strands[short])
    torch.testing.assert_close(strand_lengths(left[~short]), torch.full_like(before[~short], 0.15), rtol=0.01, atol=0.0)


def test_trimming_to_the_length_of_a_region() -> None:
    canonical = hair()
    before = strand_lengths(canonical.strands)
    left = strand_lengths(edited(Trim(length_of="ids:3", region="ids:10-39"))(canonical.strands))
    torch.testing.assert_close(left[10:], before[10:].clamp_max(before[3]), rtol=0.01, atol=0.0)
    assert torch.equal(left[:10], before[:10])
    # what an earlier edit has shortened is short
    again = strand_lengths(
        edited(Trim(0.5, region="ids:3"), Trim(length_of="ids:3", region="ids:10-39"))(canonical.strands)
    )
    torch.testing.assert_close(again[10:], before[10:].clamp_max(before[3] / 2), rtol=0.01, atol=0.0)


def test_a_trimmed_strand_is_cut_at_the_same_point_of_itself_in_every_frame() -> None:
    canonical, made = hair(), edited(Trim(0.6))
    turn = torch.linalg.qr(torch.randn(3, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(1)))[0]
    moved = canonical.strands @ turn.T + 0.3
    torch.testing.assert_close(made(moved), made(canonical.strands) @ turn.T + 0.3)
    stretched = canonical.strands * torch.tensor([1.0, 3.0, 1.0]).double()  # unevenly along each strand
    torch.testing.assert_close(made(stretched), made(canonical.strands) * torch.tensor([1.0, 3.0, 1.0]).double())


def test_colours_are_carried_along_when_trimmed() -> None:
    canonical = hair()
    ramp = torch.arange(POINTS - 1).double().expand(1, 3, STRANDS, -1).flatten(2)
    painted = replace(canonical, base_harmonic=ramp, higher_harmonics=ramp.expand(15, -1, -1))
    made = edited(Trim(0.5, region="ids:0-19"), of=painted)
    found = made.look.base_harmonic.view(3, STRANDS, POINTS - 1)
    assert torch.equal(found[:, 20:], ramp.view(3, STRANDS, -1)[:, 20:])
    assert torch.equal(made.look.higher_harmonics[4], made.look.base_harmonic[0])
    lengths = canonical.strands.diff(dim=1).norm(dim=-1)
    along = torch.nn.functional.pad(lengths.cumsum(1), (1, 0))
    for strand in range(20):
        middles = (torch.arange(POINTS - 1) + 0.5) / (POINTS - 1) * along[strand, -1] / 2
        expected = [int((along[strand] <= middle).sum()) - 1 for middle in middles]
        assert found[0, strand].tolist() == expected


@given(less=st.floats(0.02, 1.0), more=st.floats(0.02, 1.0))
def test_thinning_is_nested_and_leaves_that_share(less: float, more: float) -> None:
    less, more = min(less, more), max(less, more)
    small, large = edited(Thin(less)).look.ids.tolist(), edited(Thin(more)).look.ids.tolist()
    assert len(small) == max(round(less * STRANDS), 1)
    assert set(small) <= set(large)
    assert small == sorted(small)


def test_thinned_strands_are_spread_evenly() -> None:
    canonical = hair(strands=200)
    made = edited(Thin(0.25), of=canonical)
    roots = canonical.strands[:, 0]
    assert torch.equal(made(canonical.strands), canonical.strands[made.look.ids])
    nearest = torch.cdist(roots, roots[made.look.ids]).argmin(1)
    assert torch.equal(made.look.nearest, nearest)

    def largest_gap(ids: torch.Tensor) -> float:
        return float(torch.cdist(roots, roots[ids]).amin(1).max())

    generator = torch.Generator().manual_seed(0)
    by_chance = [largest_gap(torch.randperm(200, generator=generator)[:50]) for _ in range(20)]
    assert largest_gap(made.look.ids) < min(by_chance)


def test_thinning_a_region_leaves_the_rest_and_its_own_looks() -> None:
    canonical = hair()
    made = edited(Width(3.0, region="ids:20-39"), Thin(0.25, region="ids:0-19"))
    ids = made.look.ids
    assert ids.tolist()[-20:] == list(range(20, 40))
    assert len(ids) == 25
    torch.testing.assert_close(made.look.widths, torch.where(ids < 20, 0.001, 0.003).double())
    expected = canonical.base_harmonic.view(3, STRANDS, -1)[:, ids]
    assert torch.equal(made.look.base_harmonic.view(3, 25, -1), expected)
    # a region that has lost all its hair has no length, and thinning it again changes nothing
    bare = [Thin(0.01, region="ids:0-1"), Thin(0.01, region="ids:0-19")]
    assert len(edited(*bare).look.ids) == 21
    gone = [i for i in range(20) if i not in edited(*bare).look.ids]
    with pytest.raises(DynhairError, match="removed"):
        edited(*bare, Trim(length_of=f"ids:{gone[0]}"))
    assert len(edited(*bare, Thin(0.5, region=f"ids:{gone[0]}")).look.ids) == 21


@given(factor=st.floats(0.05, 4.0))
def test_brightness_scales_what_is_seen_from_everywhere(factor: float) -> None:
    plain, bright = seen(edited().look), seen(edited(Brightness(factor)).look)
    torch.testing.assert_close(bright, factor * plain)


@given(factors=st.lists(st.floats(0.05, 4.0), min_size=2, max_size=2, unique=True))
def test_brightness_is_monotone_and_its_edits_multiply(factors: list[float]) -> None:
    low, high = sorted(factors)
    assert (seen(edited(Brightness(high)).look) >= seen(edited(Brightness(low)).look)).all()
    both = seen(edited(Brightness(0.5), Brightness(low)).look)
    torch.testing.assert_close(both, seen(edited(Brightness(0.5 * low)).look))


def test_edits_of_a_region_leave_the_other_strands() -> None:
    plain, made = hair(), edited(Brightness(0.5, region="ids:7"), Tint("#ff0000", region="ids:9"))
    changed = (made.look.base_harmonic != plain.base_harmonic).view(3, STRANDS, -1).any(2).any(0)
    assert changed.nonzero()[:, 0].tolist() == [7, 9]


colours = st.tuples(*[st.floats(0.0, 1.0)] * 3)


def mean_colours(look: HairLook) -> torch.Tensor:
    return 0.5 + look.base_harmonic[0] / (4 * torch.pi) ** 0.5


def luminance(colours: torch.Tensor) -> torch.Tensor:
    """Of (v, n, 3), by its definition."""
    return colours.clamp_min(0) ** 2.2 @ torch.tensor([0.2126, 0.7152, 0.0722]).double()


@given(tint=colours)
def test_a_tint_keeps_luminance_and_stays_in_range(tint: tuple[float, float, float]) -> None:
    plain, made = edited().look, edited(Tint(tint)).look
    torch.testing.assert_close(luminance(mean_colours(made).T), luminance(mean_colours(plain).T), atol=1e-5, rtol=0)
    assert mean_colours(made).min() > -1e-6
    assert mean_colours(made).max() < 1 + 1e-6
    assert (seen(made) > 1).double().mean() < 0.05  # highlights alone


def test_lightness_of_a_view_is_kept_where_its_hue_is_that_of_the_mean() -> None:
    canonical = hair()
    grey = canonical.higher_harmonics.mean(1, keepdim=True)
    same = replace(canonical, higher_harmonics=grey * mean_colours(edited().look))
    before, after = edited(of=same).look, edited(Tint("#803010"), of=same).look
    lit = seen(before).amin(-1) > 0.02
    torch.testing.assert_close(luminance(seen(after))[lit], luminance(seen(before))[lit], atol=1e-5, rtol=0)
    assert lightness(seen(after)[:, lit.all(0)].movedim(-1, 0)).std(0).max() > 0.005  # the view still matters


def test_a_tint_gives_its_hue() -> None:
    tint = torch.tensor([0.5, 0.3, 0.2]).double()  # no stronger than light hair can have it
    found = seen(edited(Tint("0.5,0.3,0.2")).look)
    lit = found.amin(-1) > 0.02
    shares = found[lit] / found[lit].sum(-1, keepdim=True)
    torch.testing.assert_close(shares, (tint / tint.sum()).expand_as(shares), atol=1e-5, rtol=0)


def test_a_grey_tint_takes_the_colour_away_and_strength_mixes() -> None:
    for grey in ("#000000", "#808080", "#ffffff"):
        found = seen(edited(Tint(grey)).look)
        torch.testing.assert_close(found, found.mean(-1, keepdim=True).expand_as(found), atol=1e-5, rtol=0)
    plain, full = hair(), edited(Tint("#2040ff")).look
    half = edited(Tint("#2040ff", 0.5)).look
    torch.testing.assert_close(half.base_harmonic, (plain.base_harmonic + full.base_harmonic) / 2)
    torch.testing.assert_close(half.higher_harmonics, (plain.higher_harmonics + full.higher_harmonics) / 2)
    assert torch.equal(edited(Tint("#2040ff", 0.0)).look.base_harmonic, plain.base_harmonic)


def test_a_strong_tint_on_light_hair_is_mixed_with_grey() -> None:
    white = constant_coefficient(torch.full((1, SEGMENTS, 3), 0.95).double()).mT
    light = replace(hair(), base_harmonic=white, higher_harmonics=torch.zeros(15, 3, SEGMENTS).double())
    found = seen(edited(Tint("#0000ff"), of=light).look)[0, 0]
    assert found[2] == pytest.approx(1.0, abs=1e-6)
    assert found[0] == found[1]
    assert 0.9 < found[0] < 0.96
