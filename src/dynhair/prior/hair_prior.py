"""The hair prior: from any views of a hairstyle to strands everywhere on the scalp.

Paper, "Canonical representation": "a PCA-based hair prior with learned coarse-to-fine encoders" whose coefficients "are
decoded into strand geometry through a learned shape basis".
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from functools import cache
from importlib.resources import as_file, files
from pathlib import Path
from typing import Any

import safetensors
import safetensors.torch
import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn
from torch.nn import functional

from dynhair.errors import DynhairError
from dynhair.prior.basis import StrandBasis
from dynhair.prior.encoders import LEADING, ROUNDS, SAMPLES, CoarseEncoder, EncoderSizes, FineEncoder
from dynhair.prior.evidence import Evidence
from dynhair.storage import atomic_file
from dynhair.strands.scalp_map import ScalpFrame, texel_uv
from dynhair.strands.upsampling import upsample

SCHEMA_VERSION = 1
BUILTIN = "hair_prior.safetensors"
_KIND = "dynhair hair prior"


class HairPrior(nn.Module):
    """Encoders from evidence to a scalp texture of coefficients, and the basis that decodes them to strands.

    Args:
        basis: of strands in normal form.
        mean: coefficients of the mean hairstyle. The encoders tell how far a hairstyle is from it, in the basis's
            standard deviations.
        roots: where on the scalp the texels are in the mean, scalp units.
        sizes: widths of the encoders.
        recipe: how the prior was made; told to whoever asks, and otherwise without effect.
    """

    mean: Tensor
    texels: Tensor

    def __init__(
        self,
        basis: StrandBasis,
        mean: Float[Tensor, "k s s"],
        roots: Float[Tensor, "t 3"],
        sizes: EncoderSizes | None = None,
        recipe: Mapping[str, Any] | None = None,
    ) -> None:
        super().__init__()
        self.basis = basis
        self.size = mean.shape[-1]
        self.sizes = sizes or EncoderSizes()
        self.recipe = dict(recipe or {})
        self.register_buffer("mean", mean.clone())
        on_disc = (2 * texel_uv(self.size) - 1).square().sum(1) <= 1
        self.register_buffer("texels", on_disc.nonzero().squeeze(1), persistent=False)
        self.coarse = CoarseEncoder(roots, self.sizes)
        self.fine = FineEncoder(len(basis), self.sizes)

    def forward(self, evidence: Evidence) -> Float[Tensor, "*b k s s"]:
        """The coefficients of a hairstyle at every texel of the scalp, of one head or of a batch."""
        return self.coarse_to_fine(evidence)[-1]

    def coarse_to_fine(self, evidence: Evidence) -> list[Float[Tensor, "*b k s s"]]:
        """The coefficients as the coarse network alone has them, and after each round of the fine one.

        The coarse network tells the leading coefficients; the others are then the mean hairstyle's.
        """
        batch = evidence.volume.shape[:-4]
        volume = evidence.volume.flatten(0, -5) if batch else evidence.volume[None]
        leading, texture, features = self.coarse(volume)
        coefficients = functional.pad(leading, (0, 0, 0, 0, 0, len(self.basis) - LEADING))
        stages = [coefficients]
        for _ in range(ROUNDS):
            with torch.no_grad():
                known = self._in_units(coefficients).flatten(2)[:, :, self.texels].mT
                strands = self.coarse.roots[self.texels, None] + self.basis.decode(known, SAMPLES)
            coefficients = coefficients + self.fine(volume, features, texture, coefficients, strands, self.texels)
            stages.append(coefficients)
        return [self._in_units(stage).view(*batch, *stage.shape[1:]) for stage in stages]

    def strands(
        self,
        coefficients: Float[Tensor, "k s s"],
        valid: Bool[Tensor, "s s"],
        frame: ScalpFrame,
        positions: Float[Tensor, "n 3"],
        points: int,
    ) -> Float[Tensor, "n points 3"]:
        """Decode coefficients to strands that grow from given roots (supplement: upsampling).

        Args:
            coefficients: a scalp texture.
            valid: texels that may be read: those that lie on the scalp, and grow hair.
            frame: of the scalp.
            positions: roots in the head frame, metres.
            points: of a strand.

        Returns:
            Strands in the head frame, metres; the roots are exactly at their positions. Differentiable in coefficients
            and positions.
        """
        texture = self.basis.decode(coefficients.movedim(0, -1), points)
        grown = upsample(texture, valid, frame.uv(positions))
        return positions[:, None] + frame.radius * grown

    def save(self, path: Path | str) -> None:
        """Write the prior, atomically; the networks in half precision."""
        description = {
            "kind": _KIND,
            "version": SCHEMA_VERSION,
            "sizes": asdict(self.sizes),
            "recipe": self.recipe,
        }
        tensors = {f"network.{name}": value.half() for name, value in self.state_dict().items()}
        tensors |= {f"basis.{name}": value for name, value in self.basis.to_state().items()}
        tensors |= {"network.mean": self.mean}
        tensors = {name: value.detach().cpu().contiguous() for name, value in tensors.items()}
        with atomic_file(path) as temporary:
            safetensors.torch.save_file(tensors, temporary, metadata={"dynhair": json.dumps(description)})

    @classmethod
    def load(cls, path: Path | str) -> HairPrior:
        """Open a prior. Nothing in the file is executed.

        Raises:
            DynhairError: the file is missing, damaged, something else, or of a later version.
        """
        path = Path(path)
        description, tensors = _read(path)
        try:
            state = {name.removeprefix("network."): t for name, t in tensors.items() if name.startswith("network.")}
            basis = {name.removeprefix("basis."): t for name, t in tensors.items() if name.startswith("basis.")}
            prior = cls(
                StrandBasis.from_state(basis),
                state["mean"].float(),
                state["coarse.roots"].float(),
                EncoderSizes(**description["sizes"]),
                description["recipe"],
            )
            prior.load_state_dict(state)
        except (KeyError, TypeError, ValueError, IndexError, RuntimeError) as error:
            raise DynhairError(
                f"the tensors do not fit their description: {error}", path=path, mend="restore or make the prior again"
            ) from None
        if not all(torch.isfinite(value).all() for value in (*prior.state_dict().values(), *basis.values())):
            raise DynhairError("holds a NaN or an infinity", path=path, mend="restore or make the prior again")
        return prior.eval()

    def _in_units(self, coefficients: Tensor) -> Tensor:
        return self.mean + self.basis.deviation[:, None, None].to(coefficients) * coefficients


@cache
def builtin_prior() -> HairPrior:
    """The prior that comes with the package; always the same object, to be copied before it is changed."""
    with as_file(files("dynhair.prior") / BUILTIN) as path:
        return HairPrior.load(path)


def _read(path: Path) -> tuple[dict[str, Any], dict[str, Tensor]]:
    mend = "give a file that `dynhair prior` wrote"
    try:
        with safetensors.safe_open(path, framework="pt") as file:
            text = (file.metadata() or {}).get("dynhair", "{}")
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 (not a mapping)
        description = json.loads(text)
    except FileNotFoundError:
        raise DynhairError("the file is missing", path=path) from None
    except (OSError, ValueError, safetensors.SafetensorError) as error:
        raise DynhairError(f"not readable as safetensors ({error})", path=path, mend=mend) from None
    found = description if isinstance(description, dict) else {}
    kind, version = found.get("kind"), found.get("version")
    if kind != _KIND or version != SCHEMA_VERSION:
        raise DynhairError(
            f"kind {kind!r}, version {version!r}",
            path=path,
            expected=f"a {_KIND!r} of version {SCHEMA_VERSION}",
            mend=mend if kind != _KIND else "open it with the release that wrote it",
        )
    return found, tensors
