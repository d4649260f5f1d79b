# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The commands views train and tune: networks and parameters fitted to places."""

import logging
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import typer

from fusionslam.base.progress import Step, label_progress
from fusionslam.base.texts import counted
from fusionslam.cli import options as opt
from fusionslam.cli.console import print_table, progress
from fusionslam.cli.failures import keep, needs_extra
from fusionslam.cli.recordings import OpenScenes, build_recording

if TYPE_CHECKING:
    from fusionslam.config import Section
    from fusionslam.learning.training_loop import Progress, Trained

logger = logging.getLogger(__name__)


app = typer.Typer(
    help="Train the networks of the second stage; an interrupted training resumes.",
    no_args_is_help=True,
    rich_markup_mode=None,
)

Folder = Annotated[
    Path,
    typer.Option("--output", "-o", help="Folder for weights, ONNX, card, curves and checkpoint."),
]


S = TypeVar("S", bound="Section")


def read_config(
    defaults: S,
    *,
    print_config: Annotated[
        bool, typer.Option("--print-config", help="Print all values as YAML and train nothing.")
    ] = False,
    settings: opt.Settings = None,
    config: opt.ConfigFile = None,
) -> S:
    """Return the defaults, changed by the file, then by the settings; print them if requested."""
    from fusionslam.config import as_yaml, with_file, with_settings

    chosen = with_settings(with_file(defaults, config) if config else defaults, settings or [])
    if print_config:
        print(as_yaml(chosen), end="")
        raise typer.Exit
    return chosen


ReadConfig = Annotated[Callable[..., Any], read_config]


@app.command()
@opt.command
def shapes(
    ctx: typer.Context,
    output: Folder,
    modelnet: Annotated[
        Path | None,
        typer.Option("--modelnet", metavar="DIR", help="ModelNet40, HDF5 files or meshes."),
    ] = None,
    voxels: Annotated[
        list[Path] | None,
        typer.Option("--voxels", metavar="CLASS.npy.gz", help="Voxel grids; may be repeated."),
    ] = None,
    procedural: Annotated[
        bool, typer.Option(help="Also use procedural shapes, which need no download.")
    ] = True,
    *,
    read_config: ReadConfig,
) -> None:
    """Train features on shapes, as the thesis does: writes features.*."""
    _check_extras()
    from fusionslam.learning.classification import ShapesTrainingConfig
    from fusionslam.learning.train import Origin, train_shapes
    from fusionslam.learning.training_data import load_shapes

    chosen = read_config(ShapesTrainingConfig())
    train, test, words = load_shapes(chosen.procedural, modelnet, voxels or (), procedural)
    keep(ctx, output)
    with progress() as step:
        origin = Origin(opt.command_line(), words)
        trained = train_shapes((train, test), chosen, output, origin, _show_epochs(step))
    _report(output, trained)


@app.command()
@opt.command
def comparison(
    ctx: typer.Context,
    scenes: opt.SceneSets,
    output: Folder,
    features: Annotated[
        Path, typer.Option("--features", metavar="FILE", help="features.safetensors.")
    ],
    shapes: Annotated[
        str | None,
        opt.one_of("--shapes", names=opt.SHAPES, check=False, help="Shapes of recordings."),
    ] = None,
    *,
    read_config: ReadConfig,
) -> None:
    """Train the comparison of two feature vectors on recorded places: writes comparison.*."""
    _check_extras()
    from fusionslam.learning.pair_comparison import ComparisonTrainingConfig
    from fusionslam.learning.train import Origin, train_comparison
    from fusionslam.learning.training_data import collect_places
    from fusionslam.pipelines.recording import Recording
    from fusionslam.pipelines.scenes import record_scenes

    chosen = read_config(ComparisonTrainingConfig())
    recordings = [Recording.at(path, shapes=shapes) for path in scenes]
    places = collect_places([record_scenes(each.open()) for each in recordings])
    origin = Origin(opt.command_line(), ", ".join(path.name for path in scenes))
    keep(ctx, output)
    with progress() as step:
        trained = train_comparison(places, features, chosen, output, origin, _show_epochs(step))
    _report(output, trained)


@app.command()
@opt.command
def places(
    ctx: typer.Context,
    output: Folder,
    *,
    read_config: ReadConfig,
) -> None:
    """Train features end to end on simulated places, with colours: writes features.*."""
    _check_extras()
    needs_extra("sim")
    from fusionslam.learning.train import Origin, PlacesTrainingConfig, train_places
    from fusionslam.learning.training_data import load_simulated_places

    chosen = read_config(PlacesTrainingConfig())
    keep(ctx, output)
    with progress() as step:
        made = [
            load_simulated_places(part, output / f"{name}.npz", label_progress(step, "simulating"))
            for name, part in chosen.simulated
        ]
        origin = Origin(opt.command_line(), "simulated")
        trained = train_places(made[0], made[1], chosen, output, origin, _show_epochs(step))
    _report(output, trained)


def _check_extras() -> None:
    needs_extra("learn")
    needs_extra("report", module="matplotlib")


def _show_epochs(step: Step) -> "Progress":
    def show(done: int, total: int, row: Mapping[str, float]) -> None:
        figures = ", ".join(f"{name} {row[name]:.3f}" for name in row if name != "epoch")
        step(f"training ({figures})" if done == total else "training", done, total)

    return show


def _report(folder: Path, trained: "Trained") -> None:
    names = list(trained.rows[0])
    rows = [[f"{row[name]:.4g}" for name in names] for row in trained.rows]
    print_table(names, rows)
    print(f"{folder}: {counted(len(rows), 'epoch')}, {trained.cpu_seconds:.0f} s of CPU")


@opt.command
def tune(
    ctx: typer.Context,
    scenes: opt.SceneSets,
    output: Annotated[Path, typer.Option("--output", "-o", help="YAML for --config.")],
    *,
    views_config: Annotated[Callable[[], Any], partial(opt.views_config, source=None)],
    open_scenes: OpenScenes,
    jobs: opt.Jobs = None,
) -> None:
    """Search for the parameters of the similarity that recognise places best.

    An interrupted call resumes where it stopped, with the same result.
    """
    from fusionslam.cli.view_tables import HEADS, figures, without_sensor
    from fusionslam.pipelines.tuning import TuningState, write_tuning
    from fusionslam.pipelines.tuning import tune as find

    needs_extra("tune")
    whole = views_config()
    state = output.with_name(f"{output.name}.state")
    for file in (output, state):
        opt.check_output(file, *scenes, views_config)
    keep(ctx, state)
    with progress() as step:
        sets = [open_scenes(build_recording(path), whole, step) for path in scenes]

        def show(done: int, total: int, best: float) -> None:
            step(f"tuning, best {best:.4f}", done, total)
            logger.info("generation %d of %d: best %.6f", done, total, best)

        result = find(
            sets,
            whole.views,
            whole.tuning,
            state=TuningState(state),
            jobs=opt.cores(jobs),
            progress=show,
        )
    write_tuning(output, result, whole.tuning, sets, opt.command_line())
    rows: list[list[str]] = []
    for each, report in zip(sets, result.reports, strict=True):
        rows += [[each.name, *figures(report)], *without_sensor(each, report.rule_name)]
    print_table(["", *HEADS], rows)
    print(f"{output}: value {result.value:.4f}")
