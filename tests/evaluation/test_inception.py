"""The Inception network: its weights from archives made here, and the published ones against their own program."""

from __future__ import annotations

import os
import pickle
import sys
import types
import zipfile
from collections import OrderedDict
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch import _utils, nn
from torch.nn.functional import batch_norm, conv2d

from dynhair.errors import DynhairError
from dynhair.evaluation.inception import FEATURES, SIDE, InceptionNetwork, resized
from dynhair.evaluation.inception_weights import ConvolutionWeights, read_inception_weights


class Stored:
    """Pickles as a tensor of a TorchScript archive does."""

    def __init__(self, array: np.ndarray, storages: list[np.ndarray], strides: tuple[int, ...] | None = None) -> None:
        self.key = str(len(storages))
        self.array = array
        self.strides = strides or tuple(stride // array.itemsize for stride in array.strides)
        storages.append(array)

    def __reduce__(self) -> tuple[Any, ...]:
        arguments = (_Storage(self.key, self.array.size), 0, self.array.shape, self.strides, False, OrderedDict())
        return _utils._rebuild_tensor_v2, arguments


class _Storage:
    def __init__(self, key: str, count: int) -> None:
        self.key, self.count = key, count


class _Pickler(pickle.Pickler):
    def persistent_id(self, obj: Any, /) -> Any:
        return ("storage", torch.FloatStorage, obj.key, "cpu", obj.count) if isinstance(obj, _Storage) else None


@pytest.fixture
def module_class(monkeypatch: pytest.MonkeyPatch) -> type:
    """A class that lies where TorchScript's do."""
    network = types.ModuleType("__torch__.network")
    kind = type("Layer", (), {"__module__": network.__name__})
    vars(network)["Layer"] = kind
    monkeypatch.setitem(sys.modules, "__torch__", types.ModuleType("__torch__"))
    monkeypatch.setitem(sys.modules, network.__name__, network)
    return kind


def made(kind: type, **attributes: object) -> Any:
    module = kind()
    vars(module).update(attributes)
    return module


def write_archive(path: Path, content: object, storages: list[np.ndarray]) -> Path:
    with zipfile.ZipFile(path, "w") as archive:
        with archive.open("net/data.pkl", "w") as file:
            _Pickler(file, 2).dump(content)
        for key, array in enumerate(storages):
            archive.writestr(f"net/data/{key}", array.tobytes())
    return path


def layer(kind: type, seed: int, storages: list[np.ndarray], shape: tuple[int, ...] = (4, 3, 3, 3)) -> Any:
    generator = np.random.default_rng(seed)
    arrays = {"weight": shape, "beta": shape[:1], "mean": shape[:1], "var": shape[:1]}
    stored = {name: Stored(generator.uniform(0.5, 2.0, size).astype("f4"), storages) for name, size in arrays.items()}
    return made(kind, training=False, **stored)


def test_convolutions_are_read_in_the_order_of_the_modules(module_class: type, tmp_path: Path) -> None:
    storages: list[np.ndarray] = []
    first, second, third = (layer(module_class, seed, storages) for seed in range(3))
    block = made(module_class, pool=made(module_class, stride=2), tower=made(module_class, conv=second), conv=third)
    net = made(module_class, net=made(module_class, conv=first, mixed=block), training=False)
    found = read_inception_weights(write_archive(tmp_path / "net.pt", net, storages))
    assert len(found) == 3
    for read, given in zip(found, (first, second, third), strict=True):
        for tensor, name in (
            (read.kernel, "weight"),
            (read.shift, "beta"),
            (read.mean, "mean"),
            (read.variance, "var"),
        ):
            np.testing.assert_array_equal(tensor, vars(given)[name].array)


def test_normalisation_is_folded_into_the_convolution() -> None:
    generator = torch.Generator().manual_seed(0)
    weights = ConvolutionWeights(
        torch.randn(5, 3, 3, 3, generator=generator), *(torch.rand(5, generator=generator) + 0.5 for _ in range(3))
    )
    images = torch.rand(2, 3, 9, 9, generator=generator)
    expected = batch_norm(conv2d(images, weights.kernel), weights.mean, weights.variance, bias=weights.shift, eps=1e-3)
    torch.testing.assert_close(conv2d(images, *weights.folded()), expected, rtol=1e-5, atol=1e-5)


class Trap:
    """Would make a file when unpickled."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple[Any, tuple[str]]:
        return os.mkdir, (str(self.path),)


def test_an_archive_that_names_anything_else_runs_nothing(module_class: type, tmp_path: Path) -> None:
    storages: list[np.ndarray] = []
    net = made(module_class, conv=layer(module_class, 0, storages), extra=Trap(tmp_path / "sprung"))
    with pytest.raises(DynhairError, match="mkdir"):
        read_inception_weights(write_archive(tmp_path / "net.pt", net, storages))
    assert not (tmp_path / "sprung").exists()


def test_damaged_and_other_files_are_refused(module_class: type, tmp_path: Path) -> None:
    storages: list[np.ndarray] = []
    net = made(module_class, conv=layer(module_class, 0, storages))
    short = write_archive(tmp_path / "short.pt", net, storages[:-1])
    no_zip = tmp_path / "no_zip.pt"
    no_zip.write_bytes(b"weights")
    transposed = Stored(np.ones((2, 3), "f4"), storages, (1, 2))
    columns = write_archive(tmp_path / "columns.pt", made(module_class, weight=transposed), storages)
    for bad in (short, no_zip, columns, tmp_path / "missing.pt"):
        with pytest.raises(DynhairError, match="not the weights of the Inception network"):
            read_inception_weights(bad)


def test_another_networks_weights_are_refused(module_class: type, tmp_path: Path) -> None:
    storages: list[np.ndarray] = []
    net = made(module_class, conv=layer(module_class, 0, storages))
    with pytest.raises(DynhairError, match="not the weights of this network: 1 convolutions"):
        InceptionNetwork.from_file(write_archive(tmp_path / "net.pt", net, storages))


@pytest.mark.parametrize(("height", "width"), [(20, 31), (299, 299), (350, 299)])
def test_images_are_resized_from_their_first_pixel_on(height: int, width: int) -> None:
    image = np.random.default_rng(0).random((height, width, 3))
    expected = image
    for axis, size in enumerate((height, width)):
        places, pixels = np.arange(SIDE) * size / SIDE, np.arange(size)
        expected = np.apply_along_axis(partial(np.interp, places, pixels), axis, expected)
    np.testing.assert_allclose(resized(torch.from_numpy(image)[None])[0], expected, rtol=1e-10)


def test_it_has_the_size_of_inception_v3() -> None:
    network = InceptionNetwork()
    convolutions = [part for part in network.modules() if isinstance(part, nn.Conv2d)]
    assert len(convolutions) == 94
    assert sum(part.weight.numel() for part in convolutions) == 21_751_136
    assert network(torch.rand(1, 40, 30, 3)).shape == (1, FEATURES)


# Mean, root mean square and the first features, as TorchScript runs the archive on images that its package resized.
PUBLISHED = {
    "portrait": (0.3116635, 0.4423404, 0.2124381, 0.1935082, 0.2345915, 0.2124111),
    "mirrored": (0.3091460, 0.4264242, 0.2806525, 0.2051311, 0.1786077, 0.1796897),
    "black": (0.1219246, 0.4339572, 0.9087914, 0.0000000, 0.0499630, 0.0061230),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", ["portrait", "mirrored", "black"])
def test_the_published_weights_give_the_features_of_their_program(name: str) -> None:
    from skimage import data  # bundled with scikit-image: a portrait in the public domain

    image = torch.from_numpy(data.astronaut()[:200, 130:330].copy()).float() / 255
    images = {"portrait": image, "mirrored": image.flip(1), "black": image * 0}
    features = InceptionNetwork.pretrained()(images[name][None])[0]
    found = [features.mean(), features.square().mean().sqrt(), *features[:4]]
    assert torch.stack(found).tolist() == pytest.approx(PUBLISHED[name], abs=2e-5)
