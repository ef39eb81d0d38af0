"""LPIPS of frames against the network called on each image by itself."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from PIL import Image

from dynhair.errors import DynhairError
from dynhair.evaluation.face import FaceRegion, Square
from dynhair.evaluation.perception import LEAST_FACE, Perception, enlarged
from dynhair.losses import PerceptualDistance
from dynhair.losses.perceptual import NetworkName


def images(seed: int) -> torch.Tensor:
    return torch.rand(3, 90, 100, 3, generator=torch.Generator().manual_seed(seed))


def test_each_view_is_compared_as_a_whole_and_in_its_face(random_network: Perception) -> None:
    squares = (Square(5, 10, 70), None, Square(30, 2, 40))
    face = FaceRegion(torch.zeros(3, 90, 100, dtype=torch.bool), squares)
    first, second = images(0), images(1)
    whole, faces = random_network.compare(random_network.see(first, face), random_network.see(second, face))
    distance = random_network.distance
    assert distance is not None
    torch.testing.assert_close(whole, distance(first, second))
    torch.testing.assert_close(faces[0], distance(first[0, 10:80, 5:75], second[0, 10:80, 5:75]))
    assert faces[1].isnan()
    small = [enlarged(image[2, 2:42, 30:70]) for image in (first, second)]
    torch.testing.assert_close(faces[2], distance(small[0], small[1]))
    assert (whole > 0.01).all()


def test_equal_images_have_no_distance(random_network: Perception) -> None:
    seen = random_network.see(images(0), None)
    whole, faces = random_network.compare(seen, seen)
    assert whole.tolist() == [0.0, 0.0, 0.0]
    assert faces.isnan().all()


@pytest.mark.parametrize("side", [20, 63, 64, 100])
def test_only_small_faces_are_enlarged(side: int) -> None:
    face = images(2)[0, :side, :side] if side <= 90 else torch.rand(side, side, 3)
    larger = enlarged(face)
    assert larger.shape == (max(side, LEAST_FACE), max(side, LEAST_FACE), 3)
    assert larger.min() >= 0.0
    assert larger.max() <= 1.0
    if side >= LEAST_FACE:
        assert torch.equal(larger, face)


def test_enlarging_keeps_what_is_seen() -> None:
    rows = torch.linspace(0.2, 0.8, 32)[:, None, None].expand(32, 32, 3)
    shown = Image.fromarray((rows.numpy() * 255).round().astype("uint8")).resize((64, 64), Image.Resampling.BICUBIC)
    expected = torch.from_numpy(np.array(shown)).float() / 255
    torch.testing.assert_close(enlarged(rows)[8:-8], expected[8:-8], atol=0.01, rtol=0.0)


def test_weights_that_cannot_be_had_are_no_error(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(network: str) -> PerceptualDistance:
        raise DynhairError(f"lpips-{network} is missing and no source could give it:\n  a mirror: no route")

    monkeypatch.setattr(PerceptualDistance, "pretrained", fail)
    perception = Perception.published()
    assert perception.distance is None
    assert perception.description == "lpips-alexnet is missing and no source could give it"
    assert perception.for_images(100, 100) is perception
    with pytest.raises(ValueError, match="lpips-alexnet is missing"):
        perception.see(images(0), None)


@pytest.mark.parametrize(
    ("network", "title", "sha256"),
    [
        ("alexnet", "AlexNet", "443c5bc35326b81e4ac7517b853fd22d3effe38783697d87e2ec65cb01d744b1"),
        ("vgg16", "VGG16", "2ecbe4ce01168921c28dfd502e2b74490ef8c4d66b0a0286bc7a6127facccc9d"),
    ],
)
def test_the_published_networks_name_themselves(
    network: NetworkName, title: str, sha256: str, monkeypatch: pytest.MonkeyPatch, random_network: Perception
) -> None:
    asked = []

    def pretrained(name: str) -> PerceptualDistance | None:
        asked.append(name)
        return random_network.distance

    monkeypatch.setattr(PerceptualDistance, "pretrained", pretrained)
    perception = Perception.published(network)
    assert asked == [network]
    assert perception.distance is random_network.distance
    assert perception.description == f"LPIPS 0.1 with {title} (lpips-{network}, SHA-256 {sha256})"


def test_images_that_are_too_small_say_so(random_network: Perception) -> None:
    assert random_network.for_images(40, 40) is random_network
    small = random_network.for_images(40, 24)
    assert small.distance is None
    assert small.description == "an image of 40 x 24 pixels is too small for LPIPS"
