"""`niryo-jax workspace`: capability maps, and what can be made of them."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.text import Text

from niryo_jax import workspace as ws
from niryo_jax.cli.choice import ArmArgument, BaseOption, TipOption, load_arm
from niryo_jax.cli.console import busy, show_lines, show_table, stderr
from niryo_jax.cli.options import JsonOption
from niryo_jax.cli.outcome import ExitCode, Failure, print_json
from niryo_jax.cli.shapes import (
    CollisionModelOption,
    CollisionOption,
    CollisionToolOption,
    MarginOption,
    TableOption,
    collision_check,
)
from niryo_jax.cli.workspace_files import (
    file_name,
    refusals,
    resumable,
    task_poses,
    whole_map,
    written,
)
from niryo_jax.cli.workspace_views import placements_document, placements_table, report, show
from niryo_jax.workspace.orientations import KINDS

workspace = typer.Typer(
    name="workspace",
    help="Capability maps: what an arm can reach, exactly, and where to put it.",
)

MapArgument = Annotated[Path, typer.Argument(metavar="MAP", help="A store that `map` has written.")]
ShareOption = Annotated[
    str | None,
    typer.Option(
        metavar="I/N",
        help="Compute the I-th (0 to N-1) of N parts of the map: one of N processes.",
    ),
]
DistributedOption = Annotated[
    bool,
    typer.Option(
        "--distributed",
        help="Take the share from jax.distributed, which finds Slurm, Open MPI and cloud TPUs.",
    ),
]


@workspace.command("map")
def make_map(
    context: typer.Context,
    arm: ArmArgument = None,
    store: Annotated[
        Path | None,
        typer.Option("--store", "-o", help="The Zarr store to write; ROBOT.zarr unless given."),
    ] = None,
    voxel: Annotated[float, typer.Option(help="Edge of a voxel, metres.")] = 0.025,
    bounds: Annotated[
        tuple[float, float, float, float, float, float] | None,
        typer.Option(
            metavar="X0 Y0 Z0 X1 Y1 Z1", help="Corners of the box, metres; all reach unless given."
        ),
    ] = None,
    orientations: Annotated[int, typer.Option(min=1, help="How many orientations.")] = 200,
    kind: Annotated[str, typer.Option(help=f"Their kind: {', '.join(KINDS)}.")] = KINDS[0],
    rolls: Annotated[
        int, typer.Option(min=1, help="Kind directions: rolls about each direction.")
    ] = 1,
    axis: Annotated[
        tuple[float, float, float],
        typer.Option(metavar="X Y Z", help="Kind directions: axis of approach, tool frame."),
    ] = (1.0, 0.0, 0.0),
    seed: Annotated[int, typer.Option(min=0, help="Which set of orientations.")] = 0,
    dexterous: Annotated[
        float, typer.Option(help="Least singular value of a posture clear of singularities.")
    ] = 0.05,
    length: Annotated[
        float, typer.Option(help="Metres that count as much as a radian in singular values.")
    ] = 1.0,
    full: Annotated[bool, typer.Option("--full", help="Keep the numbers of each pose.")] = False,
    collision: CollisionOption = False,
    table: TableOption = None,
    margin: MarginOption = None,
    collision_model: CollisionModelOption = None,
    collision_tool: CollisionToolOption = None,
    base: BaseOption = None,
    tip: TipOption = None,
    share: ShareOption = None,
    distributed: DistributedOption = False,
    dry_run: Annotated[
        bool,
        typer.Option("--dry-run", help="Only say what it would cost: measured on a few tiles."),
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Test every orientation at the centre of every voxel by complete inverse kinematics.

    With --collision a pose counts as reached only by an arm that does not collide.
    A run that was ended goes on when the same command is given again, or `resume`.
    """
    part = _share(context, share, distributed)
    robot = load_arm("niryo_one" if arm is None else arm, base, tip)
    corners = None if bounds is None else (bounds[:3], bounds[3:])
    check = collision_check(
        robot, collision, table, margin, collision_model, collision_tool, base, tip
    )
    with refusals():
        chosen = ws.orientations(orientations, kind, seed=seed, rolls=rolls, axis=axis)
        spec = ws.MapSpec.of(robot, voxel, corners, chosen, dexterous, length, None, full, check)
        if dry_run:
            with busy("measuring a few tiles"):
                cost = ws.estimate(spec)
            show("Cost of the map", cost._asdict(), as_json)
            return
        where = store or Path(f"{file_name(robot.name)}.zarr")
        _announce(spec, where)
        with resumable(), ws.progress_bar("map", "poses") as progress:
            found = ws.capability_map(
                robot,
                voxel,
                corners,
                chosen,
                store=where,
                full=full,
                dexterous=dexterous,
                length=length,
                collisions=check,
                share=part,
                progress=progress,
            )
    report(found, where, as_json)


@workspace.command("resume")
def resume(
    context: typer.Context,
    store: MapArgument,
    share: ShareOption = None,
    distributed: DistributedOption = False,
    as_json: JsonOption = False,
) -> None:
    """Go on with a map whose run was ended, and compute damaged chunks again."""
    part = _share(context, share, distributed)
    with refusals(), resumable(), ws.progress_bar("map", "poses") as progress:
        found = ws.resume(store, share=part, progress=progress)
    report(found, store, as_json)


@workspace.command("info")
def info(store: MapArgument, as_json: JsonOption = False) -> None:
    """What a map is of, whether it is whole and undamaged, and its main numbers."""
    with refusals():
        found = ws.open_map(store, partial=True)
    report(found, store, as_json)


@workspace.command("plot")
def plot(
    store: MapArgument,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            help="File .png, .svg or .pdf; MAP-KIND.png or MAP-OF.png unless given.",
        ),
    ] = None,
    kind: Annotated[str, typer.Option(help=f"One of {', '.join(ws.plots.PLOTS)}.")] = "overview",
    of: Annotated[
        str | None, typer.Option(help="Kind sections: the variable, e.g. limit_margin_best.")
    ] = None,
) -> None:
    """Draw a map, for a paper or a page."""
    if kind not in ws.plots.PLOTS:
        raise typer.BadParameter(f"--kind: expected one of {', '.join(ws.plots.PLOTS)}")
    if of is not None and kind != "sections":
        raise typer.BadParameter("--of goes with --kind sections")
    with refusals():
        found = whole_map(store)
        figure = ws.plots.sections(found, of) if of else ws.plots.PLOTS[kind](found)
        where = output or Path(f"{store.resolve().stem}-{of or kind}.png")
        with written(where):
            ws.plots.save(figure, where)
    show_lines(f"wrote {where}")


@workspace.command("export")
def export(
    store: MapArgument,
    output: Annotated[Path, typer.Argument(help="File .npz, or .ply for a point cloud.")],
    of: Annotated[
        str | None,
        typer.Option(help="PLY: the variable that colours; reachability_index unless given."),
    ] = None,
) -> None:
    """Write a map for other tools: all arrays as npz, or the voxels as a point cloud."""
    if output.suffix not in (".npz", ".ply"):
        raise typer.BadParameter(f"OUTPUT: expected a name that ends in .npz or .ply, got {output}")
    if of is not None and output.suffix != ".ply":
        raise typer.BadParameter("--of goes with a .ply file")
    with refusals():
        found = whole_map(store)
        with written(output):
            if output.suffix == ".npz":
                ws.to_npz(found, output)
            else:
                ws.to_ply(found, output, of or "reachability_index")
    show_lines(f"wrote {output}")


@workspace.command("place-base")
def place_base(
    store: MapArgument,
    tasks: Annotated[
        Path,
        typer.Argument(
            help="Task poses, world frame, metres: .npy of (t, 4, 4), or text, a line for each "
            "with x y z and a quaternion w x y z."
        ),
    ],
    headings: Annotated[
        int, typer.Option(min=1, help="Turns about the vertical that are tried.")
    ] = 24,
    height: Annotated[float, typer.Option(help="Height of the base, metres.")] = 0.0,
    region: Annotated[
        tuple[float, float, float, float] | None,
        typer.Option(metavar="X0 Y0 X1 Y1", help="Where the base may stand, metres."),
    ] = None,
    step: Annotated[
        float | None, typer.Option(help="Distance of the places, metres; the map's voxel.")
    ] = None,
    most: Annotated[int, typer.Option(min=1, help="How many placements to show.")] = 10,
    as_json: JsonOption = False,
) -> None:
    """Where to put the robot so that it reaches task poses, best first; checked exactly."""
    with refusals():
        poses, seen = task_poses(tasks), whole_map(store)
    with refusals(), ws.progress_bar("placements", "placements") as progress:
        found = ws.base_placement(
            seen,
            poses,
            region=None if region is None else (region[:2], region[2:]),
            step=step,
            headings=headings,
            height=height,
            most=most,
            progress=progress,
        )
    document = placements_document(found)
    if not as_json:
        show_table(placements_table(found))
    if not len(found.base) or not np.all(found.reached[0]):
        raise Failure(
            "no placement was found from which all task poses are reached",
            ExitCode.NO_SOLUTION,
            document,
        )
    if as_json:
        print_json(document)


@workspace.command("compare")
def compare(
    first: Annotated[Path, typer.Argument(metavar="MAP-A")],
    second: Annotated[Path, typer.Argument(metavar="MAP-B")],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Draw the differences: .png, .svg, .pdf.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """What changes from one map to another: two robots, or two sets of limits."""
    with refusals():
        found = ws.compare(whole_map(first), whole_map(second))
        if output is not None:
            figure = ws.plots.differences(found)
            with written(output):
                ws.plots.save(figure, output)
    numbers = {name: value for name, value in found.attrs.items() if np.isscalar(value)}
    show(f"From {first} to {second}", numbers, as_json)


def _share(context: typer.Context, share: str | None, distributed: bool) -> tuple[int, int] | None:
    """Which part of the chunks this process computes; before anything uses JAX's devices."""
    if distributed:
        if share is not None:
            raise typer.BadParameter("--share and --distributed: expected one of the two")
        try:
            context.with_resource(ws.one_of_many())
        except (ValueError, RuntimeError) as error:
            raise Failure(f"--distributed: {error}", ExitCode.USAGE) from error
        return None
    if share is None:
        return None
    match = re.fullmatch(r"([0-9]+)/([0-9]+)", share)
    index, count = map(int, match.groups()) if match else (0, 0)
    if index >= count:
        raise typer.BadParameter(
            f"--share: expected I/N with I from 0 to N-1, as in 0/2, got {share!r}"
        )
    return index, count


def _announce(spec: ws.MapSpec, where: Path) -> None:
    grid = spec.grid
    free = "" if spec.collisions is None else ", free of collisions"
    said = (
        f"{spec.robot.name}{free}: {grid.size:,} voxels of {grid.voxel:g} m x "
        f"{len(spec.quaternions):,} orientations = {spec.poses:,} poses, to {where} "
        "(the bar stands while JAX compiles)"
    )
    # As text, for names may look like markup.
    stderr().print(Text(said))
