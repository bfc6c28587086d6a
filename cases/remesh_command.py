"""`python -m remesh IN OUT`: a curvature-adapted mesh of any surface.

Exit codes as in `cases.cli`; OUT appears when it is complete, or not at all. Lengths stay in the
unit of the file.
"""

import os
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import App, Parameter

from cases import quantities
from cases.cli import run_guarded, set_threads
from cases.progress import make_reporter
from meshes.errors import InvalidCase, NotConverged

_UNIT_EXPONENT = {"m": 0, "cm": 2, "mm": 3}


@dataclass(frozen=True)
class Request:
    """What `python -m remesh` was asked for.

    Parameters
    ----------
    source, destination : Path
    vertices : int or None
    edge_length : float or None [file units]
    max_error : float, str or None
        In diagonals, or a text with a unit.
    max_normal_angle : float or None [degrees]
    min_length : float [file units]
    max_length : float or None [file units]
    gradation : float or None
    quality : "3d", "6d" or None
    sigma : float, str or None
        In diagonals, or a text with a unit; None: chosen from the surface.
    reference : "auto", "rbf" or "triangles"
    fix_boundary : bool
    fill_holes : float
        In diagonals.
    repair : bool
        Whether a surface that needs repair is repaired, or refused.
    keep_crossings : bool
        Whether faces that cross others, and cannot be repaired, are put up with.
    smooth : bool
    iterations : int
    algorithm : "default" or "thesis"
    unit : "m", "cm" or "mm"
        Of the file; only a sigma with a unit needs it.
    seed : int
    threads : int or None
    json : str or None
        A path, or "-".
    picture : Path or None
    quiet, verbose : bool
    """

    source: Path
    destination: Path
    vertices: int | None = None
    edge_length: float | None = None
    max_error: float | str | None = None
    max_normal_angle: float | None = None
    min_length: float = 0.0
    max_length: float | None = None
    gradation: float | None = None
    quality: str | None = None
    sigma: float | str | None = None
    reference: str = "auto"
    fix_boundary: bool = False
    fill_holes: float = 0.0
    repair: bool = True
    keep_crossings: bool = False
    smooth: bool = False
    iterations: int = 10
    algorithm: str = "default"
    unit: str = "mm"
    seed: int = 1
    threads: int | None = None
    json: str | None = None
    picture: Path | None = None
    quiet: bool = False
    verbose: bool = False

    def length(self, text):
        """A length with a unit, in the unit of the file."""
        return quantities.length(text) * 10.0 ** _UNIT_EXPONENT[self.unit]


def main(arguments=None):
    """Run the command; returns the exit code."""
    app = App(
        name="python -m remesh",
        help="Remesh a surface so that small triangles lie where it curves. Creases, corners, "
        "face labels, holes and values at the vertices are kept; the table printed at the end "
        "compares both surfaces.",
        help_format="markdown",
        version_flags=[],
        result_action="return_value",
        suppress_keyboard_interrupt=False,
    )
    app.default(_remesh)
    tokens = sys.argv[1:] if arguments is None else list(arguments)
    return run_guarded(lambda: app(tokens, exit_on_error=False, print_error=False))


def _flag(*names):
    return Parameter(name=list(names) or None, negative="")


def _remesh(
    source: Annotated[Path, Parameter(name="IN")],
    destination: Annotated[Path, Parameter(name="OUT")],
    /,
    *,
    vertices: int | None = None,
    edge_length: float | None = None,
    max_error: str | None = None,
    max_normal_angle: float | None = None,
    min_length: float = 0.0,
    max_length: float | None = None,
    gradation: float | None = None,
    quality: Literal["3d", "6d"] | None = None,
    sigma: str | None = None,
    reference: Literal["auto", "rbf", "triangles"] = "auto",
    fix_boundary: Annotated[bool, _flag()] = False,
    fill_holes: float = 0.0,
    no_repair: Annotated[bool, _flag()] = False,
    keep_crossings: Annotated[bool, _flag()] = False,
    smooth: Annotated[bool, _flag()] = False,
    iterations: int = 10,
    algorithm: Literal["default", "thesis"] = "default",
    unit: Literal["m", "cm", "mm"] = "mm",
    seed: int = 1,
    threads: int | None = None,
    json: Annotated[str | None, Parameter(allow_leading_hyphen=True)] = None,
    picture: Path | None = None,
    quiet: Annotated[bool, _flag()] = False,
    verbose: Annotated[bool, _flag("--verbose", "-v")] = False,
):
    """
    Parameters
    ----------
    source
        The surface: STL, PLY, OBJ, OFF or VTP.
    destination
        Where the result goes, in any of these formats; PLY and VTP keep all labels and values.
    vertices
        Number of vertices of the result; the input's if neither this nor --edge-length is given.
    edge_length
        Length of its edges in the embedding (x, sigma n), in the file's unit.
    max_error
        As few triangles as keep every point of the result, and of the input, within this distance
        of the other: in bounding-box diagonals, or with a unit as 0.1mm. The bound is proved. With
        --edge-length too no edge is longer in the embedding.
    max_normal_angle
        With --max-error: how far normals may differ, in degrees.
    min_length
        Shorter edges are collapsed, whatever sigma or --max-error ask for, unless features need
        them; in the file's unit.
    max_length
        No edge is longer than this.
    gradation
        How many times longer edges may be from one triangle to the next, such as 1.3.
    quality
        Spend time on the worst angles: in space (3d), or in the embedding (6d). If not given,
        sigma decides which angles are to be good. With --max-error more vertices are spent too,
        and the bound stays proved.
    sigma
        Weight of the normals n, in bounding-box diagonals, or with a unit as 14mm: 0 for
        triangles of one size, more for smaller ones where the surface curves. If not given: 0.05,
        or less where the normals are noisy.
    reference
        What the result is to lie on: the input's triangles, a smooth interpolant through its
        vertices (rbf), or auto: the interpolant if the result is to be finer than the input.
    fix_boundary
        Leave open boundaries exactly as they are.
    fill_holes
        Close holes up to this size, in bounding-box diagonals; 0 leaves all open.
    no_repair
        Refuse a damaged surface instead of repairing it.
    keep_crossings
        Write the result although triangles cross that do in the input, and could not be mended.
    smooth
        Smooth a jagged input first, keeping its volume.
    iterations
        Rounds of splitting, collapsing, flipping and smoothing.
    algorithm
        The default, or the thesis's Algorithm 2 as it stands.
    unit
        The file's unit; only a sigma with a unit needs it. Nothing is ever converted.
    seed
        Of the random choices (the thesis's algorithm makes some).
    threads
        Threads to compute with; all cores if not given. The results are the same.
    json
        Write all figures as JSON to this file, or instead of the table for a single -.
    picture
        Draw both surfaces into this PNG.
    quiet
        Print nothing but errors.
    verbose
        Print every step.
    """
    return run_remesh(
        Request(
            source, destination, vertices, edge_length, _parse_length("--max-error", max_error),
            max_normal_angle, min_length, max_length, gradation, quality,
            _parse_length("--sigma", sigma), reference, fix_boundary,
            fill_holes, not no_repair, keep_crossings, smooth, iterations, algorithm, unit, seed,
            threads, json, picture, quiet, verbose,
        )
    )  # fmt: skip


def run_remesh(request):
    """Read, repair, remesh, write, and print what changed.

    Raises
    ------
    InvalidCase, InvalidMesh, NotConverged
        With one sentence each; NotConverged too, when all is written, if the result is not valid.
    """
    _check(request)
    from cases import remesh_files, remesh_report  # the stages take seconds to import

    set_threads(request.threads)
    reporter = make_reporter(request.quiet, request.verbose)
    try:
        outcome = remesh_files.remesh_file(request, reporter)
    except MemoryError:
        raise NotConverged("out of memory: ask for fewer vertices or longer edges") from None
    finally:
        reporter.close()
    if request.json is not None:
        remesh_report.write_figures(request.json, outcome)
    if request.json != "-" and not request.quiet:
        remesh_report.print_table(outcome)
    if problem := remesh_files.invalid(outcome):
        raise NotConverged(problem)


def _check(request):
    """Refuse what can be refused before anything is read."""
    if request.vertices is not None and request.edge_length is not None:
        raise InvalidCase("--vertices and --edge-length: only one of the two can be given")
    _check_sizing(request)
    if request.quality is not None and request.algorithm == "thesis":
        raise InvalidCase("--quality: the thesis's algorithm has no such passes")
    _check_bound(request)
    if request.vertices is not None and request.vertices < 4:
        raise InvalidCase(f"--vertices {request.vertices}: must be at least 4")
    length = request.edge_length
    if length is not None and not 0.0 < length < float("inf"):
        raise InvalidCase(f"--edge-length {length}: must be positive")
    if not 0.0 <= request.fill_holes < float("inf"):
        raise InvalidCase(f"--fill-holes {request.fill_holes}: must not be negative")
    if request.iterations < 1:
        raise InvalidCase(f"--iterations {request.iterations}: must be at least 1")
    if request.seed < 0:
        raise InvalidCase(f"--seed {request.seed}: must be at least 0")
    if request.smooth and request.reference == "rbf":
        raise InvalidCase("--smooth and --reference rbf: a smoothed input is compared with its "
                          "own triangles; leave one of the two out")  # fmt: skip
    if request.picture is not None and request.picture.suffix.lower() != ".png":
        raise InvalidCase(f"--picture {request.picture}: must end in .png")
    _check_places(request)


def _check_sizing(request):
    """Refuse limits of the lengths that make no sense."""
    longest = float("inf") if request.max_length is None else request.max_length
    if not longest > 0.0:
        raise InvalidCase(f"--max-length {longest}: must be positive")
    if not 0.0 <= request.min_length <= longest:
        raise InvalidCase(f"--min-length {request.min_length}: must not be negative, nor above "
                          f"--max-length {longest}")  # fmt: skip
    graded = request.gradation is not None
    if graded and not 1.0 < request.gradation < float("inf"):
        raise InvalidCase(f"--gradation {request.gradation}: must be above 1, such as 1.3")
    limited = request.min_length > 0.0 or request.max_length is not None
    if request.algorithm == "thesis" and (limited or graded):
        raise InvalidCase("--min-length, --max-length and --gradation: the thesis's algorithm "
                          "knows none of them")  # fmt: skip


def _check_bound(request):
    """Refuse options that make no sense with --max-error, or without it."""
    if request.max_error is None:
        if request.max_normal_angle is not None:
            raise InvalidCase("--max-normal-angle needs --max-error")
        return
    if request.max_error == 0.0:
        raise InvalidCase("--max-error 0: must be positive")
    if request.vertices is not None:
        raise InvalidCase("--vertices and --max-error: only one of the two can be given")
    if request.smooth or request.algorithm == "thesis":
        raise InvalidCase("--max-error holds to the surface as it is: leave --smooth and "
                          "--algorithm thesis out")  # fmt: skip
    angle = request.max_normal_angle
    if angle is not None and not 0.0 < angle <= 180.0:
        raise InvalidCase(f"--max-normal-angle {angle}: must be between 0 and 180")


def _check_places(request):
    """Refuse places where nothing can be written, before hours of work."""
    places = [request.destination]
    places += [request.picture] if request.picture is not None else []
    places += [Path(request.json)] if request.json not in (None, "-") else []
    for place in places:
        folder = place.resolve().parent
        if not folder.is_dir():
            raise InvalidCase(f"{place}: the folder {folder} does not exist")
        if place.is_dir():
            raise InvalidCase(f"{place}: is a folder; name a file")
        if not os.access(folder, os.W_OK):
            raise InvalidCase(f"{place}: the folder {folder} cannot be written to")
    if len({place.resolve() for place in places}) < len(places):
        raise InvalidCase("OUT, --json and --picture must be different files")


def _parse_length(option, text):
    """A number of diagonals, a text with a unit, or None."""
    if text is None:
        return None
    try:
        if quantities.is_absolute(text):
            value, result = quantities.length(text), text
        else:
            value = result = float(text)
    except ValueError:
        value = float("nan")
    if not 0.0 <= value < float("inf"):
        raise InvalidCase(
            f"{option} {text}: must be a number that is not negative (in bounding-box diagonals), "
            "or a length with its unit, as 14mm"
        )
    return result


if __name__ == "__main__":
    raise SystemExit(main())
