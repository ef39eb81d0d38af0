"""The static stage: the canonical hairstyle from the views of the hair at rest (paper, "Canonical representation").

The strand prior's encoders see the views and guess a hairstyle; they are trained on these views for a while. Beside
them the numbers of a procedural style are searched for. From whichever looks more like the hair, the strands themselves
are moved until they do (supplement B, "Canonical initialization"). A groom from a file can take the place of both.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import torch
from jaxtyping import Float
from rich.console import Console
from torch import Tensor, nn

from dynhair.capture import Capture
from dynhair.config import StaticConfig
from dynhair.losses import PerceptualDistance
from dynhair.prior.hair_prior import HairPrior, builtin_prior
from dynhair.progress import StageProgress
from dynhair.strands import MeshDistance, push_out, resample_strands, smooth_strands
from dynhair.training.checkpoint import Checkpoint
from dynhair.training.interruption import Interruption, interruptible
from dynhair.training.previews import hairstyle_picture, write_preview
from dynhair.training.rest_scene import RestScene
from dynhair.training.run import Run, write_hair
from dynhair.training.schedule import falling_rate
from dynhair.training.static_model import POINTS, DisplacedHair, EncodedHair, Paint
from dynhair.training.static_objective import StaticObjective
from dynhair.training.static_start import encoded_hair, groom_from_file, grown_style, misfit_in_few_views
from dynhair.training.style_search import search_length

_TOTAL_WIDTH = 1.5
_NARROWEST, _WIDEST = 1e-4, 4e-3
_RATE_SHARED, _RATE_OWN, _RATE_PAINT = 1e-3, 2e-4, 1e-2
_CLEARANCE = 5e-4


def strand_width(count: int) -> float:
    """The width in metres at which ``count`` strands cover a head: 1.5 m of strands side by side.

    Worn hair hangs around the head in a curtain of about 0.6 m, so that is two to three layers. The width stays between
    a hair's, 0.1 mm, and 4 mm.
    """
    return min(max(_TOTAL_WIDTH / count, _NARROWEST), _WIDEST)


class StaticStage:
    """The static stage of a run. Killed at any moment, it goes on from its last checkpoint.

    Args:
        run: where its state lies, and its configuration.
        capture: with hair masks.
        progress: where progress is shown.
        console: where the rest is said.

    Raises:
        DynhairError: the capture has no hair masks, no hair in them, or neither a tracked mesh nor landmarks.
    """

    def __init__(self, run: Run, capture: Capture, progress: StageProgress, console: Console) -> None:
        self.run, self.progress, self.console = run, progress, console
        self.config: StaticConfig = run.config.static
        self.seed = run.config.training.seed
        hair = run.config.hair
        self.points, self.width = hair.points, strand_width(hair.strands)
        self.scene = RestScene.of(capture, self.config.image_size)
        self.prior = builtin_prior() if self.config.prior == "builtin" else HairPrior.load(Path(self.config.prior))
        wanted = self.config.weights.perceptual > 0
        self.perceptual = PerceptualDistance.pretrained() if wanted else None
        self.background = torch.from_numpy(capture.background).float()

    def finish(self) -> Float[Tensor, "n 200 3"]:
        """Do what is left of the stage.

        Returns:
            Strands in the head frame, metres, root first, outside of the head; the segments of each nearly equal.

        Raises:
            KeyboardInterrupt: Ctrl-C was pressed; everything is saved.
        """
        with interruptible() as interruption:
            if not self.run.moved_strands.exists():
                start = self._started(interruption)
                model = DisplacedHair(start)
            else:
                model = DisplacedHair(Checkpoint.read(self.run.moved_strands).model["hair.start"])
            paint = self._optimise(model, "strands", self.config.iterations, self.run.moved_strands, interruption)
        with torch.no_grad():
            strands = _finished(model(POINTS), self.scene.obstacle)
        self._preview(strands, paint)
        return strands

    def _started(self, interruption: Interruption) -> Float[Tensor, "n 200 3"]:
        """Where the strands begin: the file's groom, the encoders' guess or a procedural style."""
        count = self.run.config.hair.strands
        if self.run.hair_init is not None:
            groom = groom_from_file(self.run.hair_init, self.scene, count, self.seed)
            write_hair(groom, self.run.first_guess)
            return groom
        model = encoded_hair(self.scene, self.prior, count, self.seed)
        with torch.no_grad():
            write_hair(model(POINTS), self.run.first_guess)
        self._optimise(model, "encoders", self.config.encoder_iterations, self.run.encoders, interruption)
        with torch.no_grad():
            encoded = model(POINTS)
        generations = self.config.style_generations
        shown = self.progress.stage("canonical hair: style", search_length(generations))

        def tell(tried: int, least: float) -> None:
            shown.update(tried, f"misfit {least:.3f}")
            if interruption.requested:
                self.console.print("Stopped in the search for a style; --resume begins it anew.", highlight=False)
                raise KeyboardInterrupt

        grown = grown_style(self.scene, count, generations, self.seed, tell)
        ours, theirs = (misfit_in_few_views(strands, self.scene, self.width) for strands in (encoded, grown))
        self.console.print(
            f"Misfit of the encoders' guess {ours:.3f}, of the best procedural style {theirs:.3f}: strands begin with "
            f"the {'guess' if ours < theirs else 'style'}.",
            highlight=False,
            soft_wrap=True,
        )
        return encoded if ours < theirs else grown

    def _optimise(
        self, model: EncodedHair | DisplacedHair, name: str, iterations: int, path: Path, interruption: Interruption
    ) -> Paint:
        """Train a model and the colours on the views, from the checkpoint if there is one."""
        with torch.no_grad():
            roots = model(2)[:, 0]
        paint = self._paint(len(roots))
        stage = nn.ModuleDict({"hair": model, "paint": paint})
        optimizer = torch.optim.Adam([*self._groups(model), {"params": list(paint.parameters()), "lr": _RATE_PAINT}])
        rates = [group["lr"] for group in optimizer.param_groups]
        first = 0
        if path.exists():
            checkpoint = Checkpoint.read(path)
            checkpoint.restore(stage, optimizer)
            first = checkpoint.step
        else:
            Checkpoint.of(0, stage, optimizer).write(path)
        objective = StaticObjective(
            self.scene, roots, self.width, self.prior.basis, self.background, self.perceptual, self.config, self.seed
        )
        shown = self.progress.stage(f"canonical hair: {name}", iterations, first)
        for step in range(first, iterations):
            for group, rate in zip(optimizer.param_groups, rates, strict=True):
                group["lr"] = rate * falling_rate(step, iterations, last=0.0)
            strands = model(self.points)
            result = objective(strands, paint, step, iterations)
            optimizer.zero_grad(set_to_none=True)
            result.loss.backward()
            optimizer.step()
            done = step + 1
            shown.update(done, f"loss {float(result.loss.detach()):.4f}")
            finished = done == iterations
            if done % self.config.checkpoint_every == 0 or finished or interruption.requested:
                Checkpoint.of(done, stage, optimizer).write(path)
                self._preview(strands.detach(), paint)
            if interruption.requested and not finished:
                self.console.print(f"Stopped after step {done} of the {name}; go on with --resume.", highlight=False)
                raise KeyboardInterrupt
        return paint

    def _groups(self, model: EncodedHair | DisplacedHair) -> list[dict[str, Any]]:
        if isinstance(model, EncodedHair):
            return [{"params": list(model.parameters()), "lr": self.config.encoder_rate}]
        return [{"params": [model.shared], "lr": _RATE_SHARED}, {"params": [model.own], "lr": _RATE_OWN}]

    def _preview(self, strands: Float[Tensor, "n l 3"], paint: Paint) -> None:
        picture = hairstyle_picture(strands, self.width, self.scene, paint, self.background)
        write_preview(picture, self.run.hairstyle_preview)

    def _paint(self, strands: int) -> Paint:
        views = self.scene.views
        hair = views.rgb[views.hair > 0.9]
        body = views.rgb[torch.isfinite(self.scene.body_depth) & (views.hair < 0.1)]
        grey = torch.full((3,), 0.3)
        return Paint(
            strands,
            len(self.scene.body.means),
            hair.mean(0) if len(hair) else grey,
            body.mean(0) if len(body) else grey,
        )


def _finished(strands: Float[Tensor, "n l 3"], obstacle: MeshDistance) -> Float[Tensor, "n l 3"]:
    """Strands outside of the obstacle; their segments are equal but for the last push outwards."""
    for _ in range(3):
        smooth = smooth_strands(_outside(strands, obstacle))
        strands = resample_strands(smooth, strands.shape[1])
    return _outside(strands, obstacle)


def _outside(strands: Float[Tensor, "n l 3"], obstacle: MeshDistance) -> Float[Tensor, "n l 3"]:
    free = push_out(strands[:, 1:].flatten(0, 1), obstacle, _CLEARANCE)
    return torch.cat([strands[:, :1], free.view_as(strands[:, 1:])], 1)
