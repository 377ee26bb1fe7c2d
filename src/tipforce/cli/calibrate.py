"""``tipforce calibrate``: calibrates a bench from recordings, a board or a ruler, and writes ``bench.toml``."""

from pathlib import Path
from typing import Annotated

import typer

from ..errors import InputError
from ..types import DEFAULT_VIEW
from ._common import JsonOption, check_new, check_outputs, progress_bar, say, write_json
from ._facts import BenchOption, number_from, stated_info


def command(
    recordings: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="RECORDING...",
            help="One minute each, or a folder of them; or DICOM files, one for each view, for the views' poses.",
        ),
    ] = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="FILE", help="The bench.toml to write the values into.")
    ] = None,
    bench: BenchOption = None,
    contact_free: Annotated[
        bool,
        typer.Option(
            "--contact-free",
            help="Nothing touches in any frame; no forces are needed. A rest shape that is no arc is found, too.",
        ),
    ] = False,
    stated_within: Annotated[
        float, typer.Option(min=0.1, max=45.0, metavar="PERCENT", help="How well the stated stiffness is known.")
    ] = 10.0,
    views: Annotated[
        bool, typer.Option("--views", help="Only refine the pose of the second view, from the catheter's tip in both.")
    ] = False,
    beads: Annotated[
        Path | None,
        typer.Option(
            metavar="TABLE.csv",
            help="Marked beads of a phantom, for the poses of the views: columns view,u_px,v_px,x_mm,y_mm,z_mm.",
        ),
    ] = None,
    diameter: Annotated[
        bool,
        typer.Option(
            "--diameter", help="Only find the scale of each view of a recording, from the stated diameter of the shaft."
        ),
    ] = False,
    board: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="IMAGES",
            help="ChArUco board: an image or a folder; the first in the plane of bending. Twice, a folder or video of "
            "each of two cameras, named after its view: their poses.",
        ),
    ] = None,
    squares: Annotated[
        str | None,
        typer.Option(
            metavar="NxM,MM[,MARKER_MM[,DICTIONARY]]",
            help="The board: squares across and down, side of a square, side of a marker (default three quarters of "
            "it), OpenCV's name of the markers (default DICT_4X4_50).",
        ),
    ] = None,
    ruler: Annotated[
        str | None, typer.Option(metavar="U0,V0,U1,V1,MM", help="Two image points and the distance between them.")
    ] = None,
    view: Annotated[str, typer.Option(metavar="NAME", help="The view that the board or ruler is in.")] = DEFAULT_VIEW,
    plot: Annotated[
        Path | None, typer.Option(metavar="FILE.png", help="Draw the knob's map, the forces and the tissue.")
    ] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Change a bench.toml that is there already.")] = False,
    json_file: JsonOption = None,
) -> None:
    """Calibrate a bench: scale, sensor angle, knob map, stiffness and tissue, each with its standard deviation.

    One minute with forces is enough: five seconds without contact, then contact with the wall beating. Less accurate,
    and marked so: a recording without contact (--contact-free) and a stated stiffness. With -o the values are written
    into bench.toml: other lines stay, a line that is replaced is kept as a comment.

    Example:
        tipforce calibrate runs/monday.mcap --bench bench.toml -o bench.toml --overwrite --plot calibration.png

        tipforce calibrate free.mcap --contact-free --bench bench.toml -o bench.toml --overwrite

        tipforce calibrate --ruler 100,240,500,240,80 -o bench.toml

        tipforce calibrate --ruler 240,100,252,140,9.5 --view b --bench bench.toml -o bench.toml --overwrite

        tipforce calibrate --board board/ --squares 9x6,8 --bench bench.toml -o new.toml

        tipforce calibrate --board board_a/ --board board_b/ --squares 9x6,8 -o bench.toml

        tipforce calibrate --beads beads.csv -o bench.toml

        tipforce calibrate plane-a.dcm plane-b.dcm -o bench.toml

        tipforce calibrate biplane.mcap --views --bench bench.toml -o bench.toml --overwrite
    """
    from ..calibration import BoardSettings
    from ..io import write_atomic
    from ..pipelines import calibrate, describe_calibration, plot_calibration

    paths = recordings or []
    check_outputs([*paths, *([beads] if beads else [])], output, plot, json_file)
    check_new(output, plot, overwrite=overwrite)
    if board and squares is None:
        raise InputError("--board: state its squares, as in --squares 7x5,8: across, down, and their side in mm")
    settings = None
    if squares is not None:
        count, square_mm, marker_mm, dictionary = _squares(squares)
        settings = BoardSettings(count, 1e-3 * square_mm, None if marker_mm is None else 1e-3 * marker_mm, dictionary)
    with progress_bar() as report:
        done = calibrate(
            paths,
            bench=stated_info(bench, None),
            contact_free=contact_free,
            stated_within=0.01 * stated_within,
            board=board or None,
            board_settings=settings,
            ruler=_ruler(ruler),
            view=view,
            view_poses=views,
            by_diameter=diameter,
            beads=beads,
            progress=report,
        )
    text = None
    if output is not None:
        base = output if output.exists() else bench
        text = done.bench_text(None if base is None else base.read_text(encoding="utf-8-sig"), str(base or output))
    for line in describe_calibration(done):
        say(line)
    if output is not None and text is not None:
        write_atomic(output, text)
        names = ", ".join(done.written_keys) or "nothing: no value is good enough"
        say(f"wrote {output}: {names}")
    if plot is not None:
        plot_calibration(done, plot)
        say(f"wrote {plot}")
    write_json(done.figures(), json_file)


def _squares(text: str) -> tuple[tuple[int, int], float, float | None, str]:
    """Returns the squares across and down, the sides of a square and a marker in mm, and the name of the markers."""
    expected = "squares across and down and their side in mm, as in 7x5,8; then a marker's side and OpenCV's name"
    count, *rest = text.split(",")
    across, _, down = count.lower().partition("x")
    if not (across.strip().isdecimal() and down.strip().isdecimal() and 1 <= len(rest) <= 3):
        raise InputError(f"--squares {text}: expected {expected}")
    sides = [number_from(part, f"--squares {text}", expected) for part in rest[:2]]
    name = rest[2].strip() if len(rest) == 3 else "DICT_4X4_50"
    return (int(across), int(down)), sides[0], sides[1] if len(sides) == 2 else None, name


def _ruler(text: str | None) -> tuple[float, float, float, float, float] | None:
    """Returns two image points u0, v0, u1, v1 in px and their distance in mm; None without the option."""
    if text is None:
        return None
    expected = "U0,V0,U1,V1,MM: two image points in px and their distance in mm"
    parts = [number_from(part, f"--ruler {text}", expected) for part in text.split(",")]
    if len(parts) != 5:
        raise InputError(f"--ruler {text}: expected {expected}")
    return parts[0], parts[1], parts[2], parts[3], parts[4]
