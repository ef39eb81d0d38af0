"""Super-resolution: a small rendering of features to a larger image (paper, appendix A; Gaussian Head Avatar)."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional

from dynhair.errors import DynhairError

FACTORS = (2, 4, 8)
INITIAL_DEVIATION = 1e-3  # of the last layer's parameters: next to no correction at the start
MARGIN = 1e-3  # that upsampled colours keep from 0 and 1, where their logits would be infinite


class SuperResolution(nn.Module):
    """Convolutions from a small image of features to a larger one of colours.

    Two convolutions at the features' size; for each doubling of the size a bilinear upsampling and two convolutions
    with half as many channels; then one of 1 x 1. They end with as many channels as there are features, which for 32
    features and a factor of 4 gives Gaussian Head Avatar's 128, 64 and 32; as the area quadruples where the channels
    halve, every size costs about the same.

    The result corrects the bilinearly upsampled first three features, as colours, in the logit of a sigmoid. The
    correction is nearly nought at the start, so training begins with a blurred picture instead of a grey one. Colours
    beyond [0, 1] have no gradient from there: a loss on the small image has to bring them back.

    Everything is a convolution, so that a crop can be upsampled alone; what lies outside it counts as zeros.

    Args:
        channels: number of features, of which the first three are sRGB.
        factor: output pixels per input pixel along each side: 2, 4 or 8.

    Raises:
        DynhairError: there are fewer than three channels, or the factor is another.
    """

    def __init__(self, channels: int = 32, factor: int = 4) -> None:
        super().__init__()
        if factor not in FACTORS:
            raise DynhairError(f"super-resolution by a factor of {factor}", expected="2, 4 or 8")
        if channels < 3:
            raise DynhairError(
                f"super-resolution of {channels} channels", expected="3 or more, of which the first three are colours"
            )
        self.factor = factor
        width = channels * factor
        layers = _double_convolution(channels, width)
        while width > channels:
            upsampling = nn.Upsample(scale_factor=2, mode="bilinear")
            layers += [upsampling, *_double_convolution(width, width // 2)]
            width //= 2
        self.hidden = nn.Sequential(*layers)
        self.last = nn.Conv2d(width, 3, 1)
        for parameter in self.last.parameters():
            nn.init.normal_(parameter, std=INITIAL_DEVIATION)

    def forward(self, features: Float[Tensor, "v h w c"]) -> Float[Tensor, "v h*{self.factor} w*{self.factor} 3"]:
        """Upsample rendered features to colours in [0, 1].

        Args:
            features: of the views, the first three being colours.
        """
        planes = features.permute(0, 3, 1, 2)  # channels last in memory: a third quicker than planes on a CPU
        colours = functional.interpolate(planes[:, :3], scale_factor=self.factor, mode="bilinear")
        logits = torch.logit(colours.clamp(MARGIN, 1 - MARGIN)) + self.last(self.hidden(planes))
        return logits.sigmoid().permute(0, 2, 3, 1)


def _double_convolution(inputs: int, outputs: int) -> list[nn.Module]:
    return [
        nn.Conv2d(inputs, outputs, 3, padding=1),
        nn.LeakyReLU(inplace=True),
        nn.Conv2d(outputs, outputs, 3, padding=1),
        nn.LeakyReLU(inplace=True),
    ]
