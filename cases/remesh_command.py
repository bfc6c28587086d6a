"""`python -m remesh IN OUT`: a curvature-adapted mesh of any surface.

Exit codes as in `cases.cli`; OUT appears when it is complete, or not at all. Lengths stay in the
unit of the file.
"""

import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import App, Parameter

from cases import quantities
from cases.cli import run_guarded, set_threads
from cases.progress import make_reporter
from meshes.errors import InvalidCase

_UNIT_EXPONENT = {"m": 0, "cm": 2, "mm": 3}


@dataclass(frozen=True)
class Request:
    """What `python -m remesh` was asked for.

    Parameters
    ----------
    source, destination : Path
    vertices : int or None
    edge_length : float or None [file units]
    sigma : str
    iterations : int
    smooth : bool
    algorithm : "default" or "thesis"
    unit : "m", "cm" or "mm"
        Of the file; only a sigma with a unit needs it.
    seed : int
    threads : int or None
    quiet, verbose : bool
    """

    source: Path
    destination: Path
    vertices: int | None
    edge_length: float | None
    sigma: str
    iterations: int
    smooth: bool
    algorithm: str
    unit: str
    seed: int
    threads: int | None
    quiet: bool
    verbose: bool


def main(arguments=None):
    """Run the command; returns the exit code."""
    app = App(
        name="python -m remesh",
        help="Remesh a surface so that small triangles lie where it curves.",
        help_format="plaintext",
        version_flags=[],
        result_action="return_value",
        suppress_keyboard_interrupt=False,
    )
    app.default(_remesh)
    tokens = sys.argv[1:] if arguments is None else list(arguments)
    return run_guarded(lambda: app(tokens, exit_on_error=False, print_error=False))


def _remesh(
    source: Annotated[Path, Parameter(name="IN")],
    destination: Annotated[Path, Parameter(name="OUT")],
    /,
    *,
    vertices: int | None = None,
    edge_length: float | None = None,
    sigma: str = "0.05",
    iterations: int = 10,
    smooth: Annotated[bool, Parameter(negative="")] = False,
    algorithm: Literal["default", "thesis"] = "default",
    unit: Literal["m", "cm", "mm"] = "mm",
    seed: int = 1,
    threads: int | None = None,
    quiet: Annotated[bool, Parameter(negative="")] = False,
    verbose: Annotated[bool, Parameter(name=["--verbose", "-v"], negative="")] = False,
):
    """
    Parameters
    ----------
    source
        The surface: STL, PLY, OBJ or OFF.
    destination
        Where the result goes, in one of the same formats.
    vertices
        Number of vertices of the result; the input's if neither this nor --edge-length is given.
    edge_length
        Length of its edges in the embedding (x, sigma n), in the file's unit.
    sigma
        Weight of the normals n: 0 for triangles of one size, 0.05 for smaller ones where the
        surface curves; in bounding-box diagonals, or with a unit, as 14mm.
    iterations
        Rounds of splitting, collapsing, flipping and smoothing.
    smooth
        Smooth a jagged input first, keeping its volume.
    algorithm
        The default, or the thesis's Algorithm 2 as it stands.
    unit
        The file's unit; only a sigma with a unit needs it. Nothing is ever converted.
    seed
        Of the random choices (the thesis's algorithm makes some).
    threads
        Threads to compute with; all cores if not given.
    quiet
        Print nothing but errors.
    verbose
        Print every step.
    """
    return run_remesh(
        Request(
            source, destination, vertices, edge_length, sigma, iterations, smooth, algorithm,
            unit, seed, threads, quiet, verbose,
        )
    )  # fmt: skip


def run_remesh(request):
    """Read, remesh, write, and print what changed.

    Raises
    ------
    InvalidCase, InvalidMesh, NotConverged
        With one sentence each.
    """
    _check(request)
    sigma = _parse_sigma(request.sigma)
    from cases import remesh_files  # the stages take seconds to import

    set_threads(request.threads)
    reporter = make_reporter(request.quiet, request.verbose)
    began = time.perf_counter()
    try:
        before, after = remesh_files.remesh_file(request, sigma, _in_file_units(request), reporter)
    finally:
        reporter.close()
    if not request.quiet:
        print(remesh_files.table(before, after, time.perf_counter() - began))


def _check(request):
    """Refuse what can be refused before anything is read."""
    if request.vertices is not None and request.edge_length is not None:
        raise InvalidCase("--vertices and --edge-length: only one of the two can be given")
    if request.vertices is not None and request.vertices < 4:
        raise InvalidCase(f"--vertices {request.vertices}: must be at least 4")
    length = request.edge_length
    if length is not None and not 0.0 < length < float("inf"):
        raise InvalidCase(f"--edge-length {length}: must be positive")
    if request.iterations < 1:
        raise InvalidCase(f"--iterations {request.iterations}: must be at least 1")
    if request.seed < 0:
        raise InvalidCase(f"--seed {request.seed}: must be at least 0")
    folder = request.destination.resolve().parent
    if not folder.is_dir():
        raise InvalidCase(f"{request.destination}: the folder {folder} does not exist")


def _parse_sigma(text):
    """A number of diagonals, or a text with a unit."""
    try:
        if quantities.is_absolute(text):
            value = quantities.length(text)
        else:
            text = value = float(text)
    except ValueError:
        value = float("nan")
    if not 0.0 <= value < float("inf"):
        raise InvalidCase(
            f"--sigma {text}: must be a number that is not negative (in bounding-box diagonals), "
            "or a length with its unit, as 14mm"
        )
    return text


def _in_file_units(request):
    """A parser of lengths with a unit that gives them in the file's unit."""
    return lambda text: quantities.length(text) * 10.0 ** _UNIT_EXPONENT[request.unit]


if __name__ == "__main__":
    raise SystemExit(main())
