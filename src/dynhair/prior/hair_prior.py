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

from dynhair.errors import DynhairError
from dynhair.prior.basis import StrandBasis
from dynhair.prior.encoders import LEADING, SAMPLES, CoarseEncoder, EncoderSizes, FineEncoder
from dynhair.prior.evidence import Evidence
from dynhair.storage import atomic_file
from dynhair.strands.scalp_map import ScalpFrame
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
        sizes: widths of the encoders.
        recipe: how the prior was made; told to whoever asks, and otherwise without effect.
    """

    mean: Tensor

    def __init__(
        self,
        basis: StrandBasis,
        mean: Float[Tensor, "k s s"],
        sizes: EncoderSizes | None = None,
        recipe: Mapping[str, Any] | None = None,
    ) -> None:
        super().__init__()
        self.basis = basis
        self.size = mean.shape[-1]
        self.sizes = sizes or EncoderSizes()
        self.recipe = dict(recipe or {})
        self.register_buffer("mean", mean.clone())
        self.coarse = CoarseEncoder(self.size, self.sizes)
        self.fine = FineEncoder(len(basis), self.sizes)

    def forward(self, evidence: Evidence) -> Float[Tensor, "*b k s s"]:
        """The coefficients of a hairstyle at every texel of the scalp, of one head or of a batch."""
        return self.coarse_to_fine(evidence)[1]

    def coarse_to_fine(self, evidence: Evidence) -> tuple[Float[Tensor, "*b k s s"], Float[Tensor, "*b k s s"]]:
        """The coefficients as the coarse network alone has them, and as the fine one leaves them.

        The coarse network tells the leading coefficients; the others are then the mean hairstyle's.
        """
        batch = evidence.volume.shape[:-4]
        volume = evidence.volume.flatten(0, -5) if batch else evidence.volume[None]
        leading, texture, features = self.coarse(volume)
        rest = leading.new_zeros(len(leading), len(self.basis) - LEADING, self.size, self.size)
        coarse = torch.cat([leading, rest], 1)
        with torch.no_grad():
            strands = self._decode(self._in_units(coarse), SAMPLES)
            roots = self.coarse.roots.unflatten(0, (self.size, self.size))
            places = roots[:, :, None] + strands
        fine = coarse + self.fine(volume, features, texture, leading, places)
        shape = (*batch, *coarse.shape[1:])
        return self._in_units(coarse).view(shape), self._in_units(fine).view(shape)

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
        grown = upsample(self._decode(coefficients, points), valid, frame.uv(positions))
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

    def _decode(self, coefficients: Float[Tensor, "*b k s s"], points: int) -> Float[Tensor, "*b s s points 3"]:
        return self.basis.decode(coefficients.movedim(-3, -1), points)


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
