"""No test of the evaluation downloads a network."""

from __future__ import annotations

import pytest
import torch

from dynhair.evaluation.appearance import Appearance
from dynhair.evaluation.perception import Perception
from dynhair.losses import PerceptualDistance


@pytest.fixture(scope="session")
def random_network() -> Perception:
    """LPIPS with random weights, which tells images apart nevertheless."""
    distance = PerceptualDistance("alexnet")
    generator = torch.Generator().manual_seed(0)
    for parameter in distance.parameters():
        if parameter.ndim == 4:
            scale = (2.0 / parameter[0].numel()) ** 0.5
            parameter.copy_(scale * torch.randn(parameter.shape, generator=generator))
        elif parameter.numel():
            parameter.copy_(0.1 * torch.rand(parameter.shape, generator=generator))
    return Perception(distance.eval(), "random weights")


@pytest.fixture(scope="session")
def random_networks(random_network: Perception) -> Appearance:
    """LPIPS with random weights alone."""
    return Appearance(random_network, Perception(None, "no VGG16"), None, "no Inception")


@pytest.fixture(autouse=True)
def without_download(monkeypatch: pytest.MonkeyPatch, random_networks: Appearance) -> None:
    """Takes networks with random weights in place of the published ones."""
    monkeypatch.setattr("dynhair.evaluation.protocol.Appearance.published", lambda: random_networks)
