"""Pictures of a run: `python -m cases.pictures DIR` draws them from the files in DIR.

The run calls this as a process of its own, so that a machine without OpenGL, on which VTK may
well crash, loses the pictures and nothing else.
"""

import argparse
import os
import subprocess
import sys
from pathlib import Path

import numpy as np

from cases.resolved import read_case
from meshes import InvalidCase, InvalidMesh
from meshes.io import load_tet_mesh, read_surface
from meshes.topology import edge_table

TIMEOUT = 300.0  # seconds
_SIZE = (1600, 1000)
_MATERIAL, _CAP, _EDGE = "#d9c9a3", "#b9c7d6", "#303030"
_SUPPORT, _LOAD = "#2f6fb5", "#c8442e"
_VIEW = (0.75, -1.0, 0.6)  # from where the whole part is seen


def make_pictures(folder, timeout=TIMEOUT):
    """Draw the pictures of a run in a process of its own.

    Returns
    -------
    str or None
        One sentence if some could not be drawn.
    """
    try:
        reason = run_apart("cases.pictures", [folder], timeout)
    except subprocess.TimeoutExpired:
        return f"pictures: not all were drawn within {timeout:g} s"
    except OSError as error:
        return f"pictures: none were drawn ({error.strerror})"
    return reason and f"pictures: only those without 3D views were drawn, for {reason}"


def run_apart(module, arguments, timeout=TIMEOUT):
    """Run a module that draws in a process of its own.

    Returns
    -------
    str or None
        Why it failed, if it did.

    Raises
    ------
    subprocess.TimeoutExpired, OSError
    """
    environment = {**os.environ, "VTK_LOGGING_LEVEL": "OFF"}
    root = str(Path(__file__).resolve().parent.parent)
    earlier = environment.get("PYTHONPATH")
    environment["PYTHONPATH"] = root + (os.pathsep + earlier if earlier else "")
    command = [sys.executable, "-m", module, *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, timeout=timeout, env=environment)
    if done.returncode == 0:
        return None
    lines = done.stderr.decode(errors="replace").strip().splitlines()
    return lines[-1] if done.returncode == 2 and lines else "no OpenGL is to be had here"


def draw_all(folder):
    """Draw every picture whose data the folder has."""
    folder = Path(folder)
    pictures = folder / "pictures"
    pictures.mkdir(exist_ok=True)
    if (folder / "history.csv").is_file():
        draw_convergence(folder / "history.csv", pictures / "convergence.png")
    if (folder / "mesh.npz").is_file():
        case = read_case(folder / "case.yaml") or {}
        loads = {name: load["traction"] for name, load in case.get("loads", {}).items()}
        draw_domain(load_tet_mesh(folder / "mesh.npz"), pictures / "domain.png", loads)
    for name in ("isosurface", "smoothed"):
        if (folder / f"{name}.ply").is_file():
            draw_surface(read_surface(folder / f"{name}.ply"), pictures / f"{name}.png")
    if (folder / "surface.ply").is_file():
        surface = read_surface(folder / "surface.ply")
        draw_surface(surface, pictures / "surface.png", edges=True)
        draw_close_up(surface, pictures / "close_up.png")


def draw_convergence(history, path):
    """Draw J and its parts, and the KKT residual, over the accepted steps."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    from topopt.history import read_history

    rows = read_history(history)
    if not rows:
        return
    steps = [row.iteration for row in rows]
    figure, (upper, lower) = pyplot.subplots(2, 1, sharex=True, figsize=(8, 6), dpi=130)
    for name, label in (
        ("objective_J", "J = F + gamma E"),
        ("compliance_J", "compliance F"),
        ("ginzburg_landau_J", "interface gamma E"),
    ):
        upper.semilogy(steps, [getattr(row, name) for row in rows], label=label)
    upper.set_ylabel("energy [J]")
    lower.semilogy(steps, [row.kkt_residual for row in rows], color="k", label="KKT residual")
    lower.semilogy(steps, [row.tau for row in rows], color="0.6", label="tau [1/Pa]")
    lower.set_xlabel("accepted step")
    for axes in (upper, lower):
        axes.legend(frameon=False)
        axes.grid(alpha=0.3)
    figure.tight_layout()
    replace(path, lambda temporary: figure.savefig(temporary))
    pyplot.close(figure)


def draw_domain(mesh, path, tractions=None):
    """Draw the modelled domain with its supports, loads and symmetry planes.

    Parameters
    ----------
    mesh : TetMesh
    path : Path
    tractions : mapping of str to (3,), optional
        Direction of each load, for an arrow.
    """
    plotter = _plotter()
    plain, seen = np.ones(len(mesh.facets), dtype=bool), [mesh.points]
    for kind, colour in (("support:", _SUPPORT), ("load:", _LOAD)):
        for name, facets in mesh.facet_sets.items():
            if name.startswith(kind) and len(facets):
                plain[facets] = False
                patch = poly(mesh.points, mesh.facets[facets])
                plotter.add_mesh(patch, color=colour, lighting=False)
                direction = (tractions or {}).get(name.removeprefix("load:"))
                if kind == "load:" and direction is not None:
                    tail = _add_arrow(plotter, mesh, facets, np.asarray(direction, float))
                    seen.append(tail[None])
    walls = poly(mesh.points, mesh.facets[plain])
    plotter.add_mesh(walls, color="#f2f2f2", culling="front", ambient=0.6, diffuse=0.4)
    plotter.add_mesh(_outline(mesh), color=_EDGE, line_width=2)
    planes = ", ".join(plane.name for plane in mesh.symmetry)
    words = [("blue: held", _SUPPORT), ("red: loaded", _LOAD)]
    words += [(f"mirrored at {planes}", _EDGE)] if planes else []
    for row, (text, colour) in enumerate(words):
        plotter.add_text(text, position=(1150, 940 - 45 * row), color=colour, font_size=14)
    _shoot(plotter, np.concatenate(seen), path)


def _add_arrow(plotter, mesh, facets, direction):
    """An arrow that pushes on the middle of a load's facets; returns its tail (3,)."""
    import pyvista

    length = 0.12 * np.linalg.norm(np.ptp(mesh.points, axis=0))
    direction = direction / np.linalg.norm(direction)
    tip = mesh.points[mesh.facets[facets]].reshape(-1, 3)
    tip = 0.5 * (tip.min(axis=0) + tip.max(axis=0))
    arrow = pyvista.Arrow(start=tip - length * direction, direction=direction, scale=length)
    plotter.add_mesh(arrow, color=_LOAD)
    return tip - length * direction


def draw_surface(surface, path, edges=False):
    """Draw a surface of the whole part, planar labels in another colour."""
    plotter = _plotter()
    _add_surface(plotter, surface, edges)
    _shoot(plotter, surface.points, path)


def draw_close_up(surface, path):
    """Draw the neighbourhood of the most refined place of a surface."""
    focus, normal = most_refined(surface)
    plotter = _plotter()
    _add_surface(plotter, surface, True, line_width=2)
    distance = 2.0 * surface.diagonal
    direction = normal + 0.4 * np.array(_VIEW)
    plotter.camera.focal_point = focus
    plotter.camera.position = focus + distance * direction / np.linalg.norm(direction)
    plotter.camera.up = (0.0, 0.0, 1.0) if abs(direction[2]) < 1.2 else (0.0, 1.0, 0.0)
    plotter.camera.parallel_projection = True
    plotter.camera.parallel_scale = 0.06 * surface.diagonal
    plotter.reset_camera_clipping_range()
    replace(path, lambda temporary: plotter.screenshot(temporary))
    plotter.close()


def most_refined(surface):
    """A vertex around which the edges are short, and the mean normal there."""
    table = edge_table(surface.faces)
    ends = surface.points[table.edges]
    lengths = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
    count = np.bincount(table.edges.ravel(), minlength=len(surface.points))
    size = np.bincount(table.edges.ravel(), np.repeat(lengths, 2), minlength=len(count))
    size /= np.maximum(count, 1)
    for _ in range(40):  # averaged over a neighbourhood, so that no single short edge wins
        total = np.bincount(table.edges[:, 0], size[table.edges[:, 1]], minlength=len(count))
        total += np.bincount(table.edges[:, 1], size[table.edges[:, 0]], minlength=len(count))
        size = (size + total) / (1 + count)
    vertex = int(np.argmin(np.where(count > 0, size, np.inf)))
    near = surface.faces[(surface.faces == vertex).any(axis=1)]
    a, b, c = (surface.points[near[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a).sum(axis=0)
    return surface.points[vertex], normal / max(np.linalg.norm(normal), 1e-300)


def _plotter():
    import pyvista

    pyvista.OFF_SCREEN = True
    plotter = pyvista.Plotter(off_screen=True, window_size=_SIZE)
    plotter.set_background("white")
    plotter.enable_anti_aliasing("msaa", multi_samples=4)
    return plotter


def poly(points, faces):
    """The triangles (m, 3) as PyVista's surface."""
    import pyvista

    return pyvista.PolyData.from_regular_faces(np.array(points), np.array(faces))


def _outline(mesh):
    """The sharp edges of the domain."""
    return poly(mesh.points, mesh.facets).extract_feature_edges(
        30.0, boundary_edges=False, manifold_edges=False, non_manifold_edges=False
    )


def _add_surface(plotter, surface, edges, line_width=1):
    planar = np.array([patch.plane is not None for patch in surface.labels])
    capped = planar[surface.face_labels]
    for chosen, colour in ((~capped, _MATERIAL), (capped, _CAP)):
        if chosen.any():
            plotter.add_mesh(
                poly(surface.points, surface.faces[chosen]),
                color=colour,
                show_edges=edges,
                edge_color=_EDGE,
                line_width=line_width,
                smooth_shading=False,
            )


def _shoot(plotter, points, path):
    """Look at the points from the usual side, as large as the picture allows, and save."""
    towards = np.array(_VIEW) / np.linalg.norm(_VIEW)
    right = np.cross((0.0, 0.0, 1.0), towards)
    right /= np.linalg.norm(right)
    across, upward = points @ right, points @ np.cross(towards, right)
    half = 0.5 * max(np.ptp(upward), np.ptp(across) * _SIZE[1] / _SIZE[0])
    middle = right * (across.min() + across.max()) / 2
    middle = middle + np.cross(towards, right) * (upward.min() + upward.max()) / 2
    distance = 2.0 * np.linalg.norm(np.ptp(points, axis=0))
    middle = middle + towards * np.mean(points @ towards)
    plotter.camera.focal_point = middle
    plotter.camera.position = middle + distance * towards
    plotter.camera.up = (0.0, 0.0, 1.0)
    plotter.camera.parallel_projection = True
    plotter.camera.parallel_scale = 1.08 * half
    plotter.reset_camera_clipping_range()
    replace(path, lambda temporary: plotter.screenshot(temporary))
    plotter.close()


def replace(path, save):
    """Save under a temporary name, then rename."""
    temporary = path.with_name(f".{path.name}.png")
    try:
        save(temporary)
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def main(arguments=None):
    """Draw the pictures of the folder named on the command line."""
    parser = argparse.ArgumentParser(prog="python -m cases.pictures", description=__doc__)
    parser.add_argument("folder", help="the output folder of a run")
    folder = Path(parser.parse_args(arguments).folder)
    try:
        if not folder.is_dir():
            raise InvalidCase(f"{folder}: no such folder")
        draw_all(folder)
    except (InvalidCase, InvalidMesh, OSError) as error:
        print(error, file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
