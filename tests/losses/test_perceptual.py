"""LPIPS against plain NumPy with random weights, and with its published weights against the authors' own program."""

from __future__ import annotations

import functools
import itertools
import os
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from scipy.ndimage import gaussian_filter

from dynhair.errors import DynhairError
from dynhair.losses.lpips_weights import LpipsWeights, read_lpips_weights
from dynhair.losses.perceptual import NetworkName, PerceptualDistance, lpips_loss

SMALLEST: dict[NetworkName, int] = {"vgg16": 16, "alexnet": 31}
CHANNELS: dict[NetworkName, list[list[int]]] = {
    "vgg16": [[64, 64], [128, 128], [256, 256, 256], [512, 512, 512], [512, 512, 512]],
    "alexnet": [[64], [192], [384], [256], [256]],
}
NETWORKS: list[NetworkName] = ["vgg16", "alexnet"]


@functools.cache
def random_weights(network: NetworkName) -> LpipsWeights:
    """Weights that keep features of size one, and heads that are not negative."""
    generator = np.random.default_rng(0)
    convolutions, inputs = [], 3
    for number, outputs in enumerate(itertools.chain(*CHANNELS[network])):
        size = {("alexnet", 0): 11, ("alexnet", 1): 5}.get((network, number), 3)
        kernel = generator.normal(0, np.sqrt(2 / (inputs * size**2)), (outputs, inputs, size, size))
        bias = generator.normal(0, 0.1, outputs)
        convolutions.append((torch.from_numpy(kernel).float(), torch.from_numpy(bias).float()))
        inputs = outputs
    heads = [torch.from_numpy(generator.uniform(0, 1, stage[-1])).float() for stage in CHANNELS[network]]
    return LpipsWeights(convolutions, heads)


@functools.cache
def distance_of(network: NetworkName) -> PerceptualDistance:
    distance = PerceptualDistance(network)
    distance.set_weights(random_weights(network))
    return distance.double()


def images(side: int, count: int = 2, seed: int = 0) -> torch.Tensor:
    return torch.from_numpy(np.random.default_rng(seed).uniform(0, 1, (count, side, side + 2, 3)))


def windows(image: np.ndarray, size: int, stride: int) -> np.ndarray:
    """All windows (y, x, channel, size, size) of an image (height, width, channel)."""
    return np.lib.stride_tricks.sliding_window_view(image, (size, size), (0, 1))[::stride, ::stride]


def expected_distance(network: NetworkName, weights: LpipsWeights, first: np.ndarray, second: np.ndarray) -> float:
    """LPIPS of two images as its authors describe it."""
    seen = [(2 * image - 1 - [-0.030, -0.088, -0.188]) / [0.458, 0.448, 0.450] for image in (first, second)]
    layers = iter(weights.convolutions)
    total = 0.0
    for stage, head in enumerate(weights.heads):
        if stage in ((1, 2, 3, 4) if network == "vgg16" else (1, 2)):
            seen = [windows(image, 2 if network == "vgg16" else 3, 2).max((-2, -1)) for image in seen]
        for _ in CHANNELS[network][stage]:
            kernel, bias = (tensor.double().numpy() for tensor in next(layers))
            size = kernel.shape[-1]
            stride, padding = (4, 2) if size == 11 else (1, size // 2)
            padded = [np.pad(image, ((padding, padding), (padding, padding), (0, 0))) for image in seen]
            seen = [
                np.maximum(np.einsum("yxcij,ocij->yxo", windows(image, size, stride), kernel, optimize=True) + bias, 0)
                for image in padded
            ]
        units = [image / (np.linalg.norm(image, axis=-1, keepdims=True) + 1e-10) for image in seen]
        total += ((units[0] - units[1]) ** 2 @ head.double().numpy()).mean()
    return total


@pytest.mark.parametrize("network", NETWORKS)
def test_distances_agree_with_plain_numpy(network: NetworkName) -> None:
    first, second = images(SMALLEST[network]), images(SMALLEST[network], seed=1)
    found = distance_of(network)(first, second)
    for image in range(2):
        expected = expected_distance(network, random_weights(network), first[image].numpy(), second[image].numpy())
        assert found[image].item() == pytest.approx(expected, rel=1e-8)  # its constants are of single precision


@pytest.mark.parametrize("network", NETWORKS)
def test_it_is_a_distance_between_images(network: NetworkName) -> None:
    distance, first, second = distance_of(network), images(31), images(31, seed=1)
    there, back = distance(first, second), distance(second, first)
    torch.testing.assert_close(there, back)
    assert (there > 0).all()
    assert distance(first, first).abs().max() == 0


def test_the_loss_is_the_mean_over_images_of_any_batch() -> None:
    distance, first, second = distance_of("vgg16"), images(16, 6), images(16, 6, seed=1)
    values = distance(first, second)
    nested = distance(first.view(2, 3, 16, 18, 3), second.view(2, 3, 16, 18, 3))
    torch.testing.assert_close(nested, values.view(2, 3))
    torch.testing.assert_close(lpips_loss(distance, first, second), values.mean())
    assert distance(first[0], second[0]).shape == ()


def test_features_of_the_target_can_be_kept() -> None:
    distance, first, second = distance_of("vgg16"), images(16), images(16, seed=1)
    kept = distance.features(second)
    torch.testing.assert_close(distance.between(distance.features(first), kept), distance(first, second))
    for depth in kept:
        lengths = depth.norm(dim=1)
        torch.testing.assert_close(lengths, torch.ones_like(lengths))


@pytest.mark.parametrize("network", NETWORKS)
def test_gradients_reach_the_images_and_not_the_network(network: NetworkName) -> None:
    distance, first, second = distance_of(network), images(SMALLEST[network], 1), images(SMALLEST[network], 1, seed=1)
    direction = images(SMALLEST[network], 1, seed=2) - 0.5
    loss = lpips_loss(distance, first.requires_grad_(), second)
    loss.backward()
    assert first.grad is not None
    step = 1e-6
    with torch.no_grad():
        ahead, behind = (lpips_loss(distance, first + sign * step * direction, second) for sign in (1, -1))
    assert (first.grad * direction).sum().item() == pytest.approx(((ahead - behind) / (2 * step)).item(), rel=1e-4)
    assert all(parameter.grad is None and not parameter.requires_grad for parameter in distance.parameters())


def test_gradients_are_finite_where_the_network_sees_nothing() -> None:
    weights = random_weights("vgg16")
    blind = LpipsWeights([(kernel, bias - 10) for kernel, bias in weights.convolutions], weights.heads)
    distance = PerceptualDistance("vgg16")
    distance.set_weights(blind)
    predicted = images(16).float().requires_grad_()
    loss = lpips_loss(distance, predicted, images(16, seed=1).float())
    loss.backward()
    assert loss.item() == 0
    assert predicted.grad is not None
    assert predicted.grad.isfinite().all()


@pytest.mark.parametrize("network", NETWORKS)
def test_images_that_do_not_reach_the_last_stage_are_refused(network: NetworkName) -> None:
    small = torch.zeros(SMALLEST[network] - 1, 64, 3, dtype=torch.float64)
    with pytest.raises(DynhairError, match=f"64 x {SMALLEST[network] - 1}"):
        distance_of(network)(small, small)
    enough = torch.zeros(SMALLEST[network], 64, 3, dtype=torch.float64)
    assert distance_of(network)(enough, enough).item() == 0


def write_pickle(path: Path, content: object) -> Path:
    """As older versions of NumPy name their arrays' function."""
    path.write_bytes(pickle.dumps(content, 3).replace(b"numpy._core.multiarray", b"numpy.core.multiarray"))
    return path


def ported(weights: LpipsWeights) -> dict[str, Any]:
    """Weights as the JAX port lays them out."""
    layers = [
        {"kernel": kernel.permute(2, 3, 1, 0).numpy().copy(), "bias": bias.numpy()}
        for kernel, bias in weights.convolutions
    ]
    heads = [{"Conv_0": {"kernel": head.numpy()[None, None, :, None]}} for head in weights.heads]
    return {
        "Network_0": {f"Conv_{number}": layers[number] for number in sorted(range(len(layers)), key=str)},
        **{f"NetLinLayer_{number}": heads[number] for number in reversed(range(len(heads)))},
    }


@pytest.mark.parametrize("network", NETWORKS)
def test_weights_are_read_in_the_order_of_the_network(network: NetworkName, tmp_path: Path) -> None:
    weights = random_weights(network)
    read = read_lpips_weights(write_pickle(tmp_path / "weights.ckpt", ported(weights)))
    for (kernel, bias), (read_kernel, read_bias) in zip(weights.convolutions, read.convolutions, strict=True):
        assert torch.equal(kernel, read_kernel)
        assert torch.equal(bias, read_bias)
    assert all(torch.equal(head, read_head) for head, read_head in zip(weights.heads, read.heads, strict=True))


class Trap:
    """Would make a file when unpickled."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple[Any, tuple[str]]:
        return os.mkdir, (str(self.path),)


def test_a_pickle_that_names_anything_else_runs_nothing(tmp_path: Path) -> None:
    trapped = {**ported(random_weights("alexnet")), "extra": Trap(tmp_path / "sprung")}
    with pytest.raises(DynhairError, match="mkdir"):
        read_lpips_weights(write_pickle(tmp_path / "weights.ckpt", trapped))
    assert not (tmp_path / "sprung").exists()


@pytest.mark.parametrize("content", [[], {}, {"Network_0": {}, "Other_0": {}}, {"Network_0": {"Conv_0": {"bias": 1}}}])
def test_other_pickles_are_refused(content: object, tmp_path: Path) -> None:
    with pytest.raises(DynhairError, match="not the weights of LPIPS"):
        read_lpips_weights(write_pickle(tmp_path / "weights.ckpt", content))


def test_damaged_and_missing_files_are_refused(tmp_path: Path) -> None:
    path = write_pickle(tmp_path / "weights.ckpt", ported(random_weights("alexnet")))
    path.write_bytes(path.read_bytes()[:-1000])
    for bad in (path, tmp_path / "missing.ckpt"):
        with pytest.raises(DynhairError, match="not the weights of LPIPS"):
            read_lpips_weights(bad)


def test_weights_of_another_network_are_refused() -> None:
    with pytest.raises(DynhairError, match="5 convolutions"):
        PerceptualDistance("vgg16").set_weights(random_weights("alexnet"))


# Of the package lpips 0.1.4 in double precision, whose heads are bit for bit those of the port.
PUBLISHED: dict[NetworkName, dict[str, float]] = {
    "vgg16": {"blurred": 0.2968627957, "mirrored": 0.5308500640, "black": 0.7508501656},
    "alexnet": {"blurred": 0.4857758587, "mirrored": 0.2967245991, "black": 0.8010641493},
}


@pytest.mark.slow
@pytest.mark.parametrize("network", NETWORKS)
def test_the_published_weights_give_the_distances_of_the_authors_program(network: NetworkName) -> None:
    from skimage import data  # bundled with scikit-image: a portrait in the public domain

    image = data.astronaut()[40:140, 150:270] / 255
    others = {
        "blurred": gaussian_filter(image, (2.0, 2.0, 0.0)),
        "mirrored": image[:, ::-1].copy(),
        "black": np.zeros_like(image),
    }
    distance = PerceptualDistance.pretrained(network)
    for name, other in others.items():
        found = distance(torch.from_numpy(image).float(), torch.from_numpy(other).float())
        assert found.item() == pytest.approx(PUBLISHED[network][name], abs=2e-6)
