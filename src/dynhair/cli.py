"""The ``dynhair`` command: a verb each, no logic. Heavy imports wait until a verb runs."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, get_args

import tyro
from tyro.conf import Positional, arg, subcommand

from dynhair.ablations import ABLATIONS, AblationName
from dynhair.cli_avatar import animate, edit, export, view
from dynhair.comparison.methods import MethodName
from dynhair.comparison.options import PresetName, RowOptions
from dynhair.config import DeformerKind
from dynhair.errors import DynhairError
from dynhair.preprocess.options import ImportOptions, PreprocessOptions

StageName = Literal["static", "mesh", "dynamic"]


def demo(out: Path = Path("demo")) -> None:
    """Train a small avatar on the bundled capture and show it moving beside the truth, in about five minutes.

    An interrupted demo goes on where it was.

    Args:
        out: Folder for the run, the videos and the pictures.
    """
    from dynhair.demo import run_demo

    run_demo(out)


def preprocess(
    raw: Positional[Path],
    out: Path,
    importing: Annotated[ImportOptions, arg(name="")],
    options: Annotated[PreprocessOptions, arg(name="")],
) -> None:
    """Bring raw multi-view video to a capture that trains: masks, hair, orientation, landmarks, tracked head.

    Every step leaves a contact sheet, and the last one a page that shows everything, OUT/preprocess/report.html. What
    is done and unchanged is skipped: after an interruption the same command goes on where it was.

    Args:
        raw: The recording's folder.
        out: The capture's folder; new, empty, or begun before.
        importing: Which frames, how large.
        options: How masks, hair and head are found.
    """
    from dynhair.preprocess.pipeline import preprocess as run

    run(raw, out, importing, options)


@dataclass(frozen=True)
class ListAssets:
    """List the networks: name, use, size, licence, and whether they have been fetched."""


@dataclass(frozen=True)
class FetchAssets:
    """Fetch networks into the cache, to work offline afterwards.

    Attributes:
        names: Of the networks; all by default.
        file: Take the one that is named from this file in the place of downloading it.
    """

    names: Positional[tuple[str, ...]] = ()
    file: Path | None = None


@dataclass(frozen=True)
class AssetPath:
    """Print where a network's file is, fetching it first if need be.

    Attributes:
        name: Of the network.
    """

    name: Positional[str]


def assets(
    action: Annotated[
        Annotated[ListAssets, subcommand("list")]
        | Annotated[FetchAssets, subcommand("fetch")]
        | Annotated[AssetPath, subcommand("path")],
        arg(name=""),
    ],
) -> None:
    """The networks of preprocessing and of perceptual losses, known by name and SHA-256.

    Args:
        action: What to do.
    """
    from dynhair.assets import fetch_assets, list_assets, print_path

    match action:
        case ListAssets():
            list_assets()
        case FetchAssets(names, file):
            fetch_assets(names, file)
        case AssetPath(name):
            print_path(name)


def check(capture: Positional[Path], sheet: Path | None = None) -> None:
    """Validate a capture: one table of findings, each with file, found, expected and how to mend it.

    Exits with 1 if there are errors.

    Args:
        capture: The capture's folder.
        sheet: Where to write a contact sheet with landmarks and head axes; beside you as CAPTURE_sheet.png by default.
    """
    from dynhair.capture.check import run_check

    sys.exit(run_check(capture, sheet or Path(f"{capture.resolve().name}_sheet.png")))


def train(
    capture: Positional[Path],
    out: Path,
    preset: PresetName = "small",
    config: Path | None = None,
    iterations: int | None = None,
    seed: int | None = None,
    stages: tuple[StageName, ...] = ("static", "dynamic"),
    hair_init: Path | None = None,
    deformer: DeformerKind | None = None,
    ablation: AblationName | None = None,
    resume: bool = False,
) -> None:
    """Train an avatar on a capture.

    Ctrl-C saves; --resume goes on exactly, also after a kill.

    Args:
        capture: The capture's folder.
        out: The run's folder; the avatar is written to OUT/avatar.
        preset: Sizes and iterations. On two cores tiny takes minutes, small an hour, medium a night; paper wants
            a GPU.
        config: YAML file in the place of the preset; every run writes its own config.yaml to start from.
        iterations: Steps of the joint training, if others than the preset's.
        seed: Of everything random, if another than the preset's.
        stages: What to do: static makes the canonical hair, mesh the paper's mesh head (which the head of preset paper
            starts from), dynamic the moving avatar with all that it needs. After one of them --resume goes on.
        hair_init: A groom (.hair, .data, .ply, .npz, .abc, .usd) to start the canonical hair from, in the place of
            the strand prior's guess.
        deformer: What moves the hair: strands move by learned dynamics, modal hair swings in learned damped modes,
            paper's is a network that hears the last frames of motion; the preset's by default, which is strands in all
            but paper.
        ablation: Leave one part of the method out, as the paper's tables do.
        resume: Go on with the run in OUT, with its own configuration.
    """
    from dynhair.ablations import ablated
    from dynhair.presets import chosen_config
    from dynhair.training.trainer import train as train_avatar

    chosen = ablated(chosen_config(preset, config, iterations, seed, deformer), ablation)
    train_avatar(capture, out, chosen, stages=stages, hair_init=hair_init, resume=resume)


def evaluate(
    avatar: Positional[Path], capture: Positional[Path], out: Path | None = None, *, reenact: bool = False
) -> None:
    """Measure an avatar on a capture's motions, held-out ones first: tables, metrics.json, videos, pictures.

    Its hair at rest is measured too, from views that training saw and from held-out ones; of a run that has not got
    further than that, the hair alone.

    Args:
        avatar: The avatar's folder, or the run's.
        capture: The capture's folder.
        out: Folder for the results; beside the avatar as "evaluation" by default.
        reenact: The capture shows another person, even if the heads are too alike to tell: it drives the avatar, and
            only how the hair moves is measured.
    """
    from dynhair.evaluation import run_evaluation
    from dynhair.training import avatar_folder

    folder = avatar_folder(avatar)
    run_evaluation(folder, capture, out or folder.parent / "evaluation", reenact=reenact)


def compare(
    capture: Positional[Path],
    out: Positional[Path],
    options: Annotated[RowOptions, arg(name="")],
    methods: tuple[MethodName, ...] = get_args(MethodName),
    avatar: Path | None = None,
    drivers: tuple[Path, ...] = (),
) -> None:
    """Train and measure our method and others on one capture, all with the same split, steps and image sizes.

    Rows run side by side, each in a process of its own; OUT/ROW/train.log has what it says. A row that fails keeps none
    of the others back. Ctrl-C saves; the same command goes on where it was, also after a kill, and tries what failed
    again. Exits with 1 if a row failed.

    Args:
        capture: The capture's folder.
        out: Folder for the comparison: a run for each row, comparison.json, and the report.
        options: How rows are trained.
        methods: What to compare. Simulators need ours.
        avatar: A trained run that is taken as ours; all others then have its configuration, whatever the preset.
        drivers: Captures of other people, whose motions then drive all methods as well (cross-reenactment).
    """
    from dynhair.comparison.run import run_comparison

    sys.exit(0 if run_comparison(capture, out, options, methods=methods, avatar=avatar, drivers=drivers) else 1)


def ablate(
    capture: Positional[Path],
    out: Positional[Path],
    options: Annotated[RowOptions, arg(name="")],
    rows: tuple[AblationName, ...] = ABLATIONS,
    deformer: DeformerKind | None = None,
) -> None:
    """Train and measure our method, and what is left of it without each of its parts, as the paper's tables do.

    Rows run side by side, each in a process of its own, and begin with the same canonical hair. A row that fails keeps
    none of the others back. Ctrl-C saves; the same command goes on where it was, also after a kill, and tries what
    failed again. Exits with 1 if a row failed.

    Args:
        capture: The capture's folder.
        out: Folder for the ablation: a run for each row, comparison.json, and the report.
        options: How rows are trained.
        rows: The parts, each of which is left out by one row; the whole method is a row by itself.
        deformer: What moves the hair, if not as in the preset; pose, no-film, mlp-encoder are of paper's alone.
    """
    from dynhair.comparison.run import run_ablation

    sys.exit(0 if run_ablation(capture, out, options, rows=rows, deformer=deformer) else 1)


def report(folders: Positional[tuple[Path, ...]], out: Path = Path("report")) -> None:
    """Make a page of tables, curves and videos from what compare and ablate left, and the tables as files.

    Args:
        folders: Of comparisons and ablations. Those of several captures are averaged.
        out: Folder for the report; open its index.html.
    """
    from dynhair.report import write_report

    write_report(folders, out)


def user_study(key: Positional[Path], answers: Positional[tuple[Path, ...]]) -> None:
    """Sum up what participants of a report's blind user study answered.

    Args:
        key: The report's user_study_key.json, which says whose each clip is.
        answers: A file of each participant, as the report's user_study.html saves it.
    """
    from rich.console import Console

    from dynhair.report import sum_user_study

    Console().print(sum_user_study(answers, key))


def prior(out: Path, styles: int = 1200, steps: int = 4000, seed: int = 0) -> None:
    """Make a hair prior: grow procedural hairstyles, learn to see strands in views of them, and report on it.

    The package brings a prior along; this makes another. An interrupted making goes on where it was, and more steps go
    on with one that is done. Takes about an hour on one core, and 7 GB of memory.

    Args:
        out: Folder for the prior, OUT/hair_prior.safetensors, its report, and what it is made from.
        styles: Hairstyles to learn from.
        steps: Steps of the training.
        seed: Of everything random.
    """
    from dynhair.prior.making import make_prior

    make_prior(out, styles=styles, steps=steps, seed=seed)


VERBS = {
    "demo": demo,
    "preprocess": preprocess,
    "check": check,
    "train": train,
    "animate": animate,
    "edit": edit,
    "export": export,
    "view": view,
    "evaluate": evaluate,
    "compare": compare,
    "ablate": ablate,
    "report": report,
    "user-study": user_study,
    "prior": prior,
    "assets": assets,
}


def main() -> None:
    """Run the command line."""
    try:
        tyro.extras.subcommand_cli_from_dict(
            VERBS,
            prog="dynhair",
            description="Animatable head avatars with explicit, moving hair, from multi-view video.",
        )
    except DynhairError as error:
        print(f"dynhair: {error}", file=sys.stderr)
        sys.exit(2)
    except KeyboardInterrupt:
        sys.exit(130)
