"""The table that `python -m remesh` prints, and its JSON."""

import json
import sys

from rich.console import Console
from rich.table import Table

from cases.json_file import plain, write_json
from cases.manifest import versions

_ROWS = (
    ("vertices", "vertices", ",d"),
    ("triangles", "faces", ",d"),
    ("closed", "watertight", ""),
    ("holes", "boundary_loops", ",d"),
    ("genus", "genus", ""),
    ("self-intersecting triangles", "self_intersecting_faces", ",d"),
    ("smallest angle, mean [deg]", "min_angle_mean", ".1f"),
    ("smallest angle, worst [deg]", "min_angle_worst", ".1f"),
    ("triangles below 20 deg [%]", "pct_below_20", ".2f"),
    ("smallest angle in 6D, mean [deg]", "min_angle_6d_mean", ".1f"),
    ("longest over shortest edge", "edge_ratio", ".3g"),
    ("volume", "volume", ".6g"),
    ("distance, rms [1e-5 diagonals]", "distance_rms", "1e5"),
    ("distance, largest [1e-5 diagonals]", "distance_max", "1e5"),
    ("distance, proved bound [1e-5 diagonals]", "distance_proved", "1e5"),
    ("normals, proved bound [deg]", "normal_angle_proved", ".1f"),
)


def print_table(outcome):
    """Print both surfaces side by side, with what was chosen and how long it took."""
    console = Console(highlight=False, markup=False)
    table = Table(box=None, pad_edge=False, header_style="bold")
    table.add_column("")
    table.add_column("before", justify="right", min_width=14)
    table.add_column("after", justify="right", min_width=14)
    for name, key, form in _ROWS:
        cells = [_cell(figures.get(key), form) for figures in (outcome.before, outcome.after)]
        if any(cells):
            table.add_row(name, *cells)
    total = sum(outcome.seconds.values())
    working = sum(outcome.seconds.get(step, 0.0) for step in ("fit", "remesh"))
    table.add_row("time [s] (fit and remeshing)", "", f"{total:.1f} ({working:.1f})")
    console.print(table)
    chosen = outcome.options
    console.print(
        f"(sigma {chosen['sigma_diagonals']:.3g} diagonals, reference: {chosen['reference']})",
        soft_wrap=True,
    )


def _cell(value, form):
    if value is None:
        return ""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if form == "1e5":
        return f"{1e5 * value:.1f}"
    return format(value, form)


def figures(outcome):
    """Everything as plain numbers and texts; lengths in file units, distances in diagonals."""
    return {
        "versions": versions(),
        "input": outcome.source,
        "output": outcome.destination,
        "options": outcome.options,
        "repair": outcome.repair.as_dict(),
        "before": outcome.before,
        "after": outcome.after,
        "statistics": outcome.statistics,
        "seconds": {**outcome.seconds, "total": sum(outcome.seconds.values())},
        "notes": outcome.notes,
    }


def write_figures(place, outcome):
    """Write them as JSON to a path, or to the standard output for "-"."""
    if place == "-":
        sys.stdout.write(json.dumps(plain(figures(outcome)), indent=2, allow_nan=False) + "\n")
        sys.stdout.flush()
    else:
        write_json(place, figures(outcome))
