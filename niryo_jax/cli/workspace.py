"""`niryo-jax workspace`: capability maps, and what can be made of them."""

from __future__ import annotations

import contextlib
from collections.abc import Generator
from pathlib import Path
from typing import Annotated

import jax
import numpy as np
import typer

from niryo_jax import workspace as ws
from niryo_jax.cli.arms import load_arm
from niryo_jax.cli.console import busy, stderr, stdout
from niryo_jax.cli.options import JsonOption
from niryo_jax.cli.outcome import ExitCode, Failure
from niryo_jax.cli.workspace_views import report, show, show_placements
from niryo_jax.workspace.orientations import KINDS, rotations_of

workspace = typer.Typer(
    name="workspace",
    help="Capability maps: what an arm can reach, exactly, and where to put it.",
    no_args_is_help=True,
)

MapArgument = Annotated[Path, typer.Argument(metavar="MAP", help="A store that `map` has written.")]
ShareOption = Annotated[
    str | None,
    typer.Option(
        metavar="I/N",
        help="Compute every N-th chunk, from the I-th (0 to N-1) on: one of N processes.",
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
    arm: Annotated[
        str,
        typer.Argument(metavar="ROBOT-OR-URDF", help="A robot of `niryo-jax robots`, or a file."),
    ] = "niryo_one",
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
    orientations: Annotated[int, typer.Option(help="How many orientations.")] = 200,
    kind: Annotated[str, typer.Option(help=f"Their kind: {', '.join(KINDS)}.")] = KINDS[0],
    rolls: Annotated[int, typer.Option(help="Kind directions: rolls about each direction.")] = 1,
    seed: Annotated[int, typer.Option(help="Which set of orientations.")] = 0,
    dexterous: Annotated[
        float, typer.Option(help="Least singular value of a posture clear of singularities.")
    ] = 0.05,
    length: Annotated[
        float, typer.Option(help="Metres that count as much as a radian in singular values.")
    ] = 1.0,
    full: Annotated[bool, typer.Option("--full", help="Keep the numbers of each pose.")] = False,
    base: Annotated[str | None, typer.Option(help="URDF: the link the chain starts at.")] = None,
    tip: Annotated[str | None, typer.Option(help="URDF: the link that it ends at.")] = None,
    share: ShareOption = None,
    distributed: DistributedOption = False,
    dry_run: Annotated[
        bool,
        typer.Option("--dry-run", help="Only say what it would cost: measured on a few tiles."),
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Test every orientation at the centre of every voxel by complete inverse kinematics.

    A run that was ended goes on when the same command is given again, or `resume`.
    """
    robot = load_arm(arm, base, tip)
    part = _share(share, distributed)
    corners = None if bounds is None else (bounds[:3], bounds[3:])
    with _refusals():
        chosen = ws.orientations(orientations, kind, seed=seed, rolls=rolls)
        spec = ws.MapSpec.of(robot, voxel, corners, chosen, dexterous, length, None, full)
        if dry_run:
            with busy("measuring a few tiles"):
                cost = ws.estimate(spec)
            show("Cost of the map", cost._asdict(), as_json)
            return
        where = store or Path(f"{robot.name}.zarr")
        _announce(spec, where)
        with ws.progress_bar(f"map of {robot.name}", "poses") as progress:
            found = ws.capability_map(
                robot,
                voxel,
                corners,
                chosen,
                store=where,
                full=full,
                dexterous=dexterous,
                length=length,
                share=part,
                progress=progress,
            )
    report(found, where, as_json)


@workspace.command("resume")
def resume(
    store: MapArgument,
    share: ShareOption = None,
    distributed: DistributedOption = False,
    as_json: JsonOption = False,
) -> None:
    """Go on with a map whose run was ended, and compute damaged chunks again."""
    part = _share(share, distributed)
    with _refusals(), ws.progress_bar(f"{store}", "poses") as progress:
        found = ws.resume(store, share=part, progress=progress)
    report(found, store, as_json)


@workspace.command("info")
def info(store: MapArgument, as_json: JsonOption = False) -> None:
    """What a map is of, whether it is whole and undamaged, and its main numbers."""
    with _refusals():
        found = ws.open_map(store, partial=True)
    report(found, store, as_json)


@workspace.command("plot")
def plot(
    store: MapArgument,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="File .png, .svg or .pdf; MAP-KIND.png unless given."),
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
    with _refusals():
        found = ws.open_map(store)
        figure = ws.plots.sections(found, of) if of else ws.plots.PLOTS[kind](found)
        where = output or Path(f"{store.stem}-{kind}.png")
        ws.plots.save(figure, where)
    stdout().print(f"wrote {where}", markup=False)


@workspace.command("export")
def export(
    store: MapArgument,
    output: Annotated[Path, typer.Argument(help="File .npz, or .ply for a point cloud.")],
    of: Annotated[str, typer.Option(help="PLY: the variable that colours.")] = "reachability_index",
) -> None:
    """Write a map for other tools: all arrays as npz, or the voxels as a point cloud."""
    writers = {".npz": ws.to_npz, ".ply": lambda map, path: ws.to_ply(map, path, of)}
    if output.suffix not in writers:
        raise typer.BadParameter(f"OUTPUT: expected a name that ends in .npz or .ply, got {output}")
    with _refusals():
        writers[output.suffix](ws.open_map(store), output)
    stdout().print(f"wrote {output}", markup=False)


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
    headings: Annotated[int, typer.Option(help="Turns about the vertical that are tried.")] = 24,
    height: Annotated[float, typer.Option(help="Height of the base, metres.")] = 0.0,
    region: Annotated[
        tuple[float, float, float, float] | None,
        typer.Option(metavar="X0 Y0 X1 Y1", help="Where the base may stand, metres."),
    ] = None,
    step: Annotated[
        float | None, typer.Option(help="Distance of the places, metres; the map's voxel.")
    ] = None,
    most: Annotated[int, typer.Option(help="How many placements to show.")] = 10,
    as_json: JsonOption = False,
) -> None:
    """Where to put the robot so that it reaches task poses, best first; checked exactly."""
    with _refusals(), ws.progress_bar("placements", "placements") as progress:
        found = ws.base_placement(
            ws.open_map(store),
            _task_poses(tasks),
            region=None if region is None else (region[:2], region[2:]),
            step=step,
            headings=headings,
            height=height,
            most=most,
            progress=progress,
        )
    show_placements(found, as_json)
    if not len(found.base) or not np.all(found.reached[0]):
        raise Failure(
            "no placement was found from which all task poses are reached", ExitCode.NO_SOLUTION
        )


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
    with _refusals():
        found = ws.compare(ws.open_map(first), ws.open_map(second))
        if output is not None:
            ws.plots.save(ws.plots.differences(found), output)
    numbers = {name: value for name, value in found.attrs.items() if np.isscalar(value)}
    show(f"From {first} to {second}", numbers, as_json)


def _share(share: str | None, distributed: bool) -> tuple[int, int] | None:
    """Which part of the chunks this process computes."""
    if distributed:
        if share is not None:
            raise typer.BadParameter("--share and --distributed: expected one of the two")
        jax.distributed.initialize()
        return None
    if share is None:
        return None
    try:
        index, count = (int(part) for part in share.split("/"))
    except ValueError:
        raise typer.BadParameter(f"--share: expected I/N as in 0/2, got {share!r}") from None
    return index, count


@contextlib.contextmanager
def _refusals() -> Generator[None]:
    """What the library refuses, and what is not installed, as failures of the command."""
    try:
        yield
    except ImportError as error:
        raise Failure(str(error), ExitCode.MISSING_EXTRA) from error
    except (ValueError, FileNotFoundError) as error:
        raise Failure(str(error), ExitCode.USAGE) from error


def _announce(spec: ws.MapSpec, where: Path) -> None:
    grid = spec.grid
    stderr().print(
        f"{spec.robot.name}: {grid.size:,} voxels of {grid.voxel:g} m x {len(spec.quaternions):,} "
        f"orientations = {spec.poses:,} poses, to {where} (the program is compiled first)",
        markup=False,
    )


def _task_poses(path: Path) -> np.ndarray:
    """(t, 4, 4) poses of a file."""
    try:
        if path.suffix == ".npy":
            return np.load(path, allow_pickle=False)
        rows = np.loadtxt(path, ndmin=2)
    except (ValueError, OSError) as error:
        raise Failure(f"TASKS: cannot read {path}: {error}", ExitCode.USAGE) from error
    if rows.shape[-1] != 7:
        raise Failure(
            f"TASKS: expected lines of seven numbers (x y z, quaternion w x y z) in {path}, got "
            f"{rows.shape[-1]}",
            ExitCode.USAGE,
        )
    poses = np.tile(np.eye(4), (len(rows), 1, 1))
    poses[:, :3, 3] = rows[:, :3]
    lengths = np.linalg.norm(rows[:, 3:], axis=1, keepdims=True)
    poses[:, :3, :3] = rotations_of(rows[:, 3:] / lengths)
    return poses
