"""Both surfaces of a remeshing in one picture: `python -m cases.remesh_picture BEFORE AFTER OUT`.

Above the whole, below a close-up of the most refined place of the result. Called as a process of
its own, as `cases.pictures`.
"""

import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from cases.pictures import most_refined, poly, replace, run_apart
from meshes import InvalidCase, InvalidMesh
from meshes.io import read_surface, write_surface

_SIZE = (1800, 1500)
_SMOOTH, _FLAT, _EDGE = "#d9c9a3", "#b9c7d6", "#303030"
_VIEW = np.array([0.7, 0.8, 0.6])  # from where the surfaces are seen
_CLOSE = 0.08  # of the diagonal: half the height of the close-up
_EDGES_UP_TO = 60_000  # faces: with more, the edges would hide the whole surface


def draw_before_after(before, after, path):
    """Draw two surfaces into a PNG.

    Parameters
    ----------
    before, after : TriMesh
    path : Path

    Returns
    -------
    str or None
        One sentence if that was not possible.
    """
    with tempfile.TemporaryDirectory(prefix="phasemesh-") as folder:
        names = [Path(folder) / "before.ply", Path(folder) / "after.ply"]
        for name, mesh in zip(names, (before, after)):
            write_surface(name, mesh, scale=1.0 / mesh.diagonal)  # VTK works in single precision
        try:
            reason = run_apart("cases.remesh_picture", [*names, Path(path).resolve()])
        except subprocess.TimeoutExpired:
            reason = "it took too long"
        except OSError as error:
            reason = error.strerror
    return reason and f"{path}: no picture was drawn, for {reason}"


def draw(before, after, path):
    """Draw two surfaces (of diagonal 1) side by side, and a close-up of each."""
    import pyvista

    pyvista.OFF_SCREEN = True
    plotter = pyvista.Plotter(off_screen=True, window_size=_SIZE, shape=(2, 2), border=False)
    plotter.enable_anti_aliasing("msaa", multi_samples=4)
    focus, normal = most_refined(after)
    for column, (name, mesh) in enumerate((("before", before), ("after", after))):
        for row in (0, 1):
            plotter.subplot(row, column)
            plotter.set_background("white")
            _add(plotter, mesh, edges=row == 1 or len(mesh.faces) <= _EDGES_UP_TO)
            if row == 0:
                text = f"{name}: {len(mesh.points):,} vertices, {len(mesh.faces):,} triangles"
                plotter.add_text(text, position="upper_left", color=_EDGE, font_size=12)
                _look(plotter, *_whole(before.points))
            else:
                _look(plotter, focus, normal + 0.4 * _VIEW, _CLOSE)
    replace(Path(path), lambda temporary: plotter.screenshot(temporary))
    plotter.close()


def _add(plotter, mesh, edges):
    """The faces, those of planar labels in another colour."""
    planar = np.array([patch.plane is not None for patch in mesh.labels])[mesh.face_labels]
    for chosen, colour in ((~planar, _SMOOTH), (planar, _FLAT)):
        if chosen.any():
            plotter.add_mesh(
                poly(mesh.points, mesh.faces[chosen]),
                color=colour,
                show_edges=edges,
                edge_color=_EDGE,
                line_width=1,
            )


def _whole(points):
    """Middle, direction and half height of a view of all points."""
    towards = _VIEW / np.linalg.norm(_VIEW)
    right = np.cross((0.0, 0.0, 1.0), towards)
    right /= np.linalg.norm(right)
    up = np.cross(towards, right)
    sides = [points @ axis for axis in (right, up, towards)]
    middle = sum(0.5 * (s.min() + s.max()) * a for s, a in zip(sides, (right, up, towards)))
    half = 0.5 * max(np.ptp(sides[1]), np.ptp(sides[0]) * _SIZE[1] / _SIZE[0])
    return middle, _VIEW, 1.12 * half


def _look(plotter, focus, direction, half):
    """Look at a point from a direction, `half` as far up as down."""
    direction = direction / np.linalg.norm(direction)
    plotter.camera.focal_point = focus
    plotter.camera.position = focus + 3.0 * direction
    plotter.camera.up = (0.0, 0.0, 1.0) if abs(direction[2]) < 0.95 else (0.0, 1.0, 0.0)
    plotter.camera.parallel_projection = True
    plotter.camera.parallel_scale = half
    plotter.reset_camera_clipping_range()


def main(arguments=None):
    """Draw the surfaces of the first two files into the third."""
    before, after, path = sys.argv[1:] if arguments is None else arguments
    try:
        draw(read_surface(before), read_surface(after), path)
    except (InvalidCase, InvalidMesh, OSError) as error:
        print(error, file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
