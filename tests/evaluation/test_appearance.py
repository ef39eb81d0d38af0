"""Which images each figure looks at, and that it compares what it should."""

from __future__ import annotations

from collections.abc import Sequence

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from dynhair.errors import DynhairError
from dynhair.evaluation import appearance as module
from dynhair.evaluation.appearance import (
    APPEARANCE_FIGURES,
    FID_FIGURES,
    VGG_FIGURES,
    Appearance,
    AppearanceMeter,
    AppearanceTruths,
    spread_views,
)
from dynhair.evaluation.fid import FidSums
from dynhair.evaluation.figures import FigureSums
from dynhair.evaluation.flip import flip
from dynhair.evaluation.inception import FEATURES, InceptionNetwork
from dynhair.evaluation.perception import PERCEPTION_STRIDE, Perception
from dynhair.evaluation.truth import TrueFrame
from dynhair.losses import PerceptualDistance

VIEWS, SIDE = 3, 32
HAIRLESS = 1
"""A view without hair."""


class Thumbnail(InceptionNetwork):
    """Sees the first pixels of an image."""

    def __init__(self) -> None:
        torch.nn.Module.__init__(self)

    def forward(self, images: Tensor) -> Tensor:
        return images.flatten(1)[:, :FEATURES]


@pytest.fixture
def networks(random_network: Perception) -> Appearance:
    torch.manual_seed(0)
    vgg = Perception(PerceptualDistance("vgg16").eval(), "random VGG16")
    return Appearance(random_network, vgg, Thumbnail(), "thumbnails")


def images(seed: int) -> Tensor:
    return torch.rand(VIEWS, SIDE, SIDE, 3, generator=torch.Generator().manual_seed(seed))


def truth(index: int, *, masks: bool = True) -> TrueFrame:
    coverage = torch.rand(VIEWS, SIDE, SIDE, generator=torch.Generator().manual_seed(100 + index))
    coverage[HAIRLESS] *= 0.4
    hair = coverage > 0.5
    return TrueFrame(index, images(index), *((hair, coverage, 1 - coverage) if masks else (None, None, None)))


def measured(
    networks: Appearance, frames: Sequence[TrueFrame], *, test: bool = True
) -> tuple[AppearanceMeter, FigureSums]:
    truths = AppearanceTruths(networks, len(frames), test=test)
    sums = FigureSums()
    meter = AppearanceMeter(truths, sums)
    for frame in frames:
        meter.add(truths.frame(frame), images(50 + frame.index))
    return meter, sums


@pytest.fixture
def few_images(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "VGG_IMAGES", 4)
    monkeypatch.setattr(module, "FID_IMAGES", 9)


@pytest.mark.usefixtures("few_images")
def test_each_figure_is_that_of_the_images_it_looks_at(networks: Appearance) -> None:
    frames = [truth(index) for index in range(PERCEPTION_STRIDE + 1)]
    meter, sums = measured(networks, frames)
    expected: dict[str, list[Tensor]] = {name: [] for name in APPEARANCE_FIGURES}
    fids = {name: FidSums() for name in FID_FIGURES}
    assert networks.alexnet.distance is not None
    assert networks.vgg.distance is not None
    assert networks.inception is not None
    for number, frame in enumerate(frames):
        assert frame.hair_coverage is not None
        pair = images(50 + frame.index), frame.rgb
        dark = [image * frame.hair_coverage[..., None] for image in pair]
        for view in range(VIEWS):
            whole, hair = ([image[view : view + 1] for image in both] for both in (pair, dark))
            if number % PERCEPTION_STRIDE == 0:
                expected["flip"].append(flip(*whole))
                if view != HAIRLESS:
                    expected["hair_lpips"].append(networks.alexnet.distance(*hair))
            if view in spread_views(number, VIEWS, len(frames), 4):
                expected["lpips_vgg"].append(networks.vgg.distance(*whole))
                if view != HAIRLESS:
                    expected["hair_lpips_vgg"].append(networks.vgg.distance(*hair))
            if view in spread_views(number, VIEWS, len(frames), 9):
                fids["fid"].add(*(networks.inception(image) for image in whole))
                if view != HAIRLESS:
                    fids["hair_fid"].add(*(networks.inception(image) for image in hair))
    figures = sums.figures()
    for name in APPEARANCE_FIGURES:
        if name in FID_FIGURES:
            assert meter.fids[name].samples == fids[name].samples > 2
            assert meter.fids[name].value() == pytest.approx(fids[name].value())
        else:
            assert figures.samples[name] == len(expected[name]) > 0
            assert figures.values[name] == pytest.approx(torch.cat(expected[name]).double().mean().item(), rel=1e-4)


def test_the_larger_networks_see_no_training_segments(networks: Appearance) -> None:
    meter, sums = measured(networks, [truth(0)], test=False)
    figures = sums.figures()
    for name in (*VGG_FIGURES, *FID_FIGURES):
        assert figures.values[name] is None
        assert figures.reasons[name] == "taken of test segments alone"
    assert all(not fid.samples for fid in meter.fids.values())
    assert figures.samples["flip"] == VIEWS
    assert figures.samples["hair_lpips"] == VIEWS - 1


def test_missing_networks_give_their_reasons_and_the_rest_is_measured() -> None:
    nothing = Appearance(Perception(None, "no AlexNet"), Perception(None, "no VGG16"), None, "no Inception")
    figures = measured(nothing, [truth(0)])[1].figures()
    assert figures.reasons["hair_lpips"] == "no AlexNet"
    assert figures.reasons["lpips_vgg"] == figures.reasons["hair_lpips_vgg"] == "no VGG16"
    assert figures.reasons["fid"] == figures.reasons["hair_fid"] == "no Inception"
    assert figures.samples["flip"] == VIEWS
    assert nothing.description == "no AlexNet; no VGG16; no Inception"


def test_without_hair_masks_whole_images_are_compared(networks: Appearance) -> None:
    meter, sums = measured(networks, [truth(0, masks=False)])
    figures = sums.figures()
    assert figures.reasons["hair_lpips"] == figures.reasons["hair_lpips_vgg"] == "the capture has no hair masks"
    assert figures.reasons["hair_fid"] == "the capture has no hair masks"
    assert figures.samples["lpips_vgg"] == meter.fids["fid"].samples == VIEWS
    assert meter.fids["hair_fid"].samples == 0


def test_each_network_tells_for_itself_that_images_are_too_small(networks: Appearance) -> None:
    small = networks.for_images(40, 24)
    assert small.alexnet.distance is None
    assert small.vgg is networks.vgg
    assert small.inception is networks.inception
    assert small.description == "an image of 40 x 24 pixels is too small for LPIPS; random VGG16; thumbnails"


def test_weights_that_cannot_be_had_are_no_error(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*network: str) -> None:
        raise DynhairError(f"{network} is missing and no source could give it:\n  a mirror: no route")

    monkeypatch.undo()  # what keeps other tests from asking for the published networks
    monkeypatch.setattr(PerceptualDistance, "pretrained", fail)
    monkeypatch.setattr(InceptionNetwork, "pretrained", fail)
    found = Appearance.published()
    assert (found.alexnet.distance, found.vgg.distance, found.inception) == (None, None, None)
    assert found.inception_description == "() is missing and no source could give it"
    assert "a mirror" not in found.description


@settings(max_examples=30)
@given(st.integers(1, 12), st.integers(1, 20), st.integers(1, 100))
def test_images_are_spread_over_frames_and_views(views: int, frames: int, wanted: int) -> None:
    chosen = [spread_views(number, views, frames, wanted) for number in range(frames)]
    counts = [len(views) for views in chosen]
    assert sum(counts) == min(wanted, views * frames)
    assert max(counts) - min(counts) <= 1
    assert all(0 <= view < views for some in chosen for view in some)


def test_they_turn_through_the_views() -> None:
    chosen = [spread_views(number, 4, 64, 64) for number in range(64)]
    for view in range(4):
        assert sum(view in some for some in chosen) == 16


def test_a_quick_evaluation_has_alexnet_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Perception, "published", lambda network="alexnet": Perception(None, f"{network} is here"))
    quick = Appearance.quick()
    assert quick.alexnet.description == "alexnet is here"
    assert quick.vgg.distance is None
    assert quick.inception is None
    truths = AppearanceTruths(quick, 1, test=True)
    assert all("left out" in truths.missing[name] for name in ("lpips_vgg", "fid", "hair_fid"))
