"""Making a prior from nothing: hairstyles, basis, encoders, report."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import torch
from rich.console import Console

from dynhair.errors import DynhairError
from dynhair.prior.basis import Form
from dynhair.prior.dataset import StyleViews, make_set, read_set
from dynhair.prior.hair_prior import BUILTIN, HairPrior
from dynhair.prior.report import VIEWS, encoder_errors, write_report
from dynhair.prior.training import PriorTraining, fitted_basis, mean_hairstyle, mean_roots
from dynhair.progress import StageProgress
from dynhair.storage import read_json, write_json
from dynhair.threads import keep_large_blocks

FORM: Form = "points"
_SAVES = 10
_JUDGED_STYLES = 8


def make_prior(out: Path, *, styles: int, steps: int, seed: int, console: Console | None = None) -> HairPrior:
    """Make a prior; an interrupted making goes on where it was.

    Writes ``hair_prior.safetensors`` and ``report/`` to the folder; hairstyles and checkpoints lie there too.

    Args:
        out: the folder.
        styles: hairstyles to train on.
        steps: of the training; more of them than before go on with a prior that is done.
        seed: of everything random.
        console: to show the progress on.

    Raises:
        DynhairError: a number is not positive, or the folder holds a prior made from other numbers.
    """
    if styles < 1 or steps < 1:
        raise DynhairError(f"a prior of {styles} hairstyles in {steps} steps", expected="at least one of each")
    console = console or Console()
    keep_large_blocks()
    _begin(out, {"styles": styles, "seed": seed, "basis": FORM})
    with StageProgress(console).shown() as stages:
        growing = stages.stage("hairstyles", styles)
        make_set(out / "hairstyles", styles, seed, lambda done, total: growing.update(done, total=total))
        learnt = read_set(out / "hairstyles", "train")
        known, held_out = (read_set(out / "hairstyles", kind) for kind in ("known", "held_out"))

        torch.manual_seed(seed)
        basis = fitted_basis(learnt, FORM)
        recipe = {"styles": styles, "steps": steps, "seed": seed, "basis": FORM}
        prior = HairPrior(basis, mean_hairstyle(learnt, basis), mean_roots(learnt), recipe=recipe)
        training = PriorTraining(prior, learnt, out, steps, seed)
        stage = stages.stage("training", steps, training.step)
        training.run(
            max(1, steps // _SAVES),
            lambda step, loss: stage.update(step, f"loss {loss:.3f}"),
            lambda prior: {"known": _judged(prior, known), "held_out": _judged(prior, held_out)},
        )
        prior.eval()
        prior.save(out / BUILTIN)
        prior = HairPrior.load(out / BUILTIN)
        parts = stages.stage("report", 3)
        made = iter(range(3))
        sets = {"known families": known, "held-out families": held_out}
        write_report(out / "report", prior, sets, training.course, lambda part: parts.update(next(made), part))
        parts.update(3)
    console.print(f"prior: {out / BUILTIN}, report: {out / 'report'}", highlight=False, soft_wrap=True)
    return prior


def _judged(prior: HairPrior, styles: Sequence[StyleViews]) -> float:
    """Mean distance in millimetres, with few views and with all, over the first styles of a set."""
    errors = encoder_errors(prior, styles[:_JUDGED_STYLES], (min(VIEWS), max(VIEWS)))
    return sum(error.fine for error in errors) / len(errors)


def _begin(out: Path, recipe: dict[str, int | str]) -> None:
    """Note the recipe, or see that it is the one that was begun here."""
    path = out / "recipe.json"
    if not path.exists():
        write_json(path, recipe)
        return
    found = read_json(path)
    if found != recipe:
        raise DynhairError(
            f"a prior was begun with {found}", path=path, expected=str(recipe), mend="give another folder"
        )
