from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from dynhair.assets import asset_path
from dynhair.errors import DynhairError
from dynhair.preprocess.hair import FaceParse, FaceParser, network_hair
from dynhair.preprocess.hair.bisenet import CLASSES, BiSeNet, fold_batch_norms
from dynhair.preprocess.hair.parser import PART_OF_CLASS, PARTS, UNKNOWN, crop_to_image, sample_crop
from dynhair.preprocess.landmarks.square import FaceSquare

KEYS = Path(__file__).with_name("bisenet_celebamask_keys.txt")


def noise_image(height: int, width: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, (height, width, 3), dtype=np.uint8)


@pytest.fixture(scope="module")
def network() -> BiSeNet:
    """Random weights with normalisations that do something."""
    torch.manual_seed(0)
    network = BiSeNet().eval()
    for module in network.modules():
        if isinstance(module, torch.nn.BatchNorm2d):
            assert module.running_mean is not None
            assert module.running_var is not None
            for values, low, high in (
                (module.weight.data, 0.7, 1.3),
                (module.bias.data, -0.2, 0.2),
                (module.running_mean, -0.2, 0.2),
                (module.running_var, 0.5, 1.5),
            ):
                values.uniform_(low, high)
    return network


def test_names_and_shapes_are_those_of_the_public_state_dict():
    expected = dict(line.split() for line in KEYS.read_text().splitlines())
    own = {key: "x".join(map(str, value.shape)) or "scalar" for key, value in BiSeNet().state_dict().items()}
    assert len(own) == 191
    assert own == expected


def test_folding_changes_nothing(network: BiSeNet):
    images = torch.randn(1, 3, 96, 64)
    folded = fold_batch_norms(network)
    with torch.inference_mode():
        expected = network(images)
        assert expected.shape == (1, CLASSES, 12, 8)
        torch.testing.assert_close(folded(images), expected, rtol=1e-4, atol=1e-4)
    assert not any(isinstance(module, torch.nn.BatchNorm2d) for module in folded.modules())
    assert any(isinstance(module, torch.nn.BatchNorm2d) for module in network.modules())


def test_every_class_has_a_part():
    assert len(PART_OF_CLASS) == CLASSES
    assert [label for label, part in enumerate(PART_OF_CLASS) if PARTS[part] == "hair"] == [17]


def test_an_upright_crop_of_the_images_own_pixels_is_a_slice():
    image = noise_image(48, 64)
    square = FaceSquare((30.0, 26.0), 20.0, 0.0)
    crop = sample_crop(image, crop_to_image(square, 1.0, 20), 20)
    np.testing.assert_array_equal(crop, image[16:36, 20:40])
    mirrored = sample_crop(image, crop_to_image(square, 1.0, 20, mirrored=True), 20)
    np.testing.assert_array_equal(mirrored, crop[:, ::-1])


def test_a_turned_crop_is_upright_for_the_face():
    image = noise_image(64, 64)
    square = FaceSquare((32.0, 32.0), 32.0, math.pi / 2)  # its x axis points down in the image
    crop = sample_crop(image, crop_to_image(square, 1.0, 32), 32)
    np.testing.assert_array_equal(crop, np.rot90(image[16:48, 16:48]))


@given(st.floats(-3, 3), st.floats(0.5, 2), st.booleans(), st.integers(1, 99))
def test_the_crops_centre_is_the_squares(angle: float, scale: float, mirrored: bool, size: int):
    to_image = crop_to_image(FaceSquare((31.5, 12.25), 40.0, angle), scale, size, mirrored)
    middle = to_image @ [(size - 1) / 2, (size - 1) / 2, 1]
    np.testing.assert_allclose(middle + 0.5, (31.5, 12.25), atol=1e-9)
    corner = to_image @ [-0.5, -0.5, 1]
    assert np.linalg.norm(corner - middle) == pytest.approx(40 * scale / math.sqrt(2))


def test_a_coarse_crop_averages_instead_of_picking():
    rows, columns = np.indices((400, 400))
    image = np.repeat(np.where((rows + columns) % 2, 255, 0).astype(np.uint8)[..., None], 3, axis=2)
    crop = sample_crop(image, crop_to_image(FaceSquare((200.0, 200.0), 320.0, 0.3), 1.0, 64), 64)
    assert np.abs(crop.astype(int) - 127).max() <= 6


def test_a_coarse_crop_keeps_its_place():
    _, columns = np.indices((300, 500)) + 0.5
    image = np.repeat((columns / 500 * 250).astype(np.uint8)[..., None], 3, axis=2)
    to_image = crop_to_image(FaceSquare((250.0, 150.0), 200.0, 0.0), 1.0, 40)
    crop = sample_crop(image, to_image, 40)[20, :, 0]
    expected = (150 + (np.arange(40) + 0.5) * 5) / 500 * 250
    np.testing.assert_allclose(crop, expected, atol=1.1)


def test_labels_return_to_their_pixels_and_are_unknown_elsewhere():
    labels = np.random.default_rng(1).integers(0, CLASSES, (16, 16))
    probabilities = np.moveaxis(np.eye(CLASSES, dtype=np.float32)[labels], -1, 0).copy()
    for mirrored in (False, True):
        parse = FaceParse(probabilities, crop_to_image(FaceSquare((20.0, 18.0), 16.0, 0.0), 1.0, 16, mirrored))
        expected = np.full((40, 50), UNKNOWN)
        expected[10:26, 12:28] = labels[:, ::-1] if mirrored else labels
        np.testing.assert_array_equal(parse.labels(40, 50), expected)
        parts = parse.parts(40, 50)
        inside = expected != UNKNOWN
        np.testing.assert_array_equal(parts[inside].argmax(axis=-1), np.array(PART_OF_CLASS)[expected[inside]])
        np.testing.assert_allclose(parts[inside].sum(axis=-1), 1, atol=1e-6)
        assert not parts[~inside].any()


def test_a_part_is_as_likely_as_its_likeliest_class():
    probabilities = np.zeros((CLASSES, 4, 4), np.float32)
    probabilities[1:15] = 0.04  # spread over skin's many classes: more than hair's in sum
    probabilities[17] = 0.4
    parse = FaceParse(probabilities, crop_to_image(FaceSquare((2.0, 2.0), 4.0, 0.0), 1.0, 4))
    assert (parse.parts(4, 4).argmax(axis=-1) == PARTS.index("hair")).all()


def test_the_parser_sees_the_same_through_its_mirror(network: BiSeNet):
    parser = FaceParser(network.state_dict())
    image, square = noise_image(64, 64, 3), FaceSquare((32.0, 32.0), 48.0, 0.0)
    parse = parser.parse(image, square, mirrored=True)
    twice = parser.parse(np.ascontiguousarray(image[:, ::-1]), square)
    np.testing.assert_allclose(parse.parts(64, 64), twice.parts(64, 64)[:, ::-1], atol=0.02)
    assert parse.probabilities.shape == (CLASSES, 64, 64)
    np.testing.assert_allclose(parse.probabilities.sum(axis=0), 1, atol=1e-5)


def test_network_hair_is_nothing_outside_the_crop(network: BiSeNet):
    hair = network_hair(FaceParser(network.state_dict()), noise_image(80, 100), FaceSquare((30.0, 30.0), 20.0, 0.0))
    assert hair.shape == (80, 100)
    assert hair.dtype == np.uint8
    assert not hair[50:].any()
    assert not hair[:, 50:].any()


def test_wrong_weights_are_refused(tmp_path: Path, network: BiSeNet):
    with pytest.raises(DynhairError, match="missing"):
        FaceParser(tmp_path / "none.pth")
    path = tmp_path / "weights.pth"
    path.write_bytes(b"not weights")
    with pytest.raises(DynhairError, match="not readable"):
        FaceParser(path)
    torch.save([1, 2], path)
    with pytest.raises(DynhairError, match="holds a list"):
        FaceParser(path)
    state = dict(network.state_dict())
    del state["conv_out.conv_out.weight"]
    torch.save(state, path)
    with pytest.raises(DynhairError, match="not the weights"):
        FaceParser(path)


@pytest.mark.slow
def test_the_public_weights_find_an_astronauts_hair():
    from skimage import data  # bundled with scikit-image: a portrait in the public domain

    image = data.astronaut()
    parser = FaceParser(asset_path("bisenet-celebamask"))
    square = FaceSquare((222.0, 112.0), 150.0, 0.0)
    parse = parser.parse(image, square)
    labels = parse.labels(*image.shape[:2])
    assert parse.shows_face
    assert labels[115, 210] == 1
    assert labels[35, 200] == 17
    assert labels[80, 170] == 17
    hair = network_hair(parser, image, square)
    assert 8_000 < (hair > 127).sum() < 25_000
