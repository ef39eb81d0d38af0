"""Distributions over styles."""

from __future__ import annotations

from dataclasses import astuple

import pytest

from dynhair.errors import DynhairError
from dynhair.hairstyles import FAMILIES, HELD_OUT, random_style


def test_families_are_many_and_some_are_held_out():
    assert len(set(FAMILIES)) == len(FAMILIES) >= 14
    assert set(HELD_OUT) < set(FAMILIES)


@pytest.mark.parametrize("family", FAMILIES)
def test_a_seed_gives_one_style_and_another_seed_another(family):
    assert random_style(family, 7) == random_style(family, 7)
    assert astuple(random_style(family, 7)) != astuple(random_style(family, 8))


def test_families_with_one_seed_differ():
    assert len({random_style(family, 3) for family in FAMILIES}) == len(FAMILIES)


def test_side_partings_are_on_either_side():
    sides = {random_style("long_straight_side", seed).parting > 0 for seed in range(20)}
    assert sides == {True, False}


def test_an_unknown_family_is_refused():
    with pytest.raises(DynhairError, match="beehive"):
        random_style("beehive", 0)
