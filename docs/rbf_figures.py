"""The thesis's figures 2.4-2.6, 3.1, 3.3 and 3.5, made by rbf/.

PYTHONPATH=. python docs/rbf_figures.py [--mesh FILE] [--out docs/images]
"""

import argparse
from pathlib import Path

import matplotlib.pyplot as plt
import meshio
import numpy as np

from meshes import TriMesh
from rbf import KERNELS, fit_global, fit_surface, fit_values

ROOT = Path(__file__).resolve().parents[1]
SPOT = ROOT.parent / "shared" / "data" / "spot.ply"
SITES = np.stack([np.arange(5.0), np.zeros(5), np.zeros(5)], axis=1)
HEIGHTS = np.array([1.0, 2, 1, 2, 1])


def main():
    """Write all figures."""
    plt.switch_backend("Agg")
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--mesh", type=Path, default=SPOT)
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "images")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    data = meshio.read(options.mesh)
    mesh = TriMesh(data.points, data.cells_dict["triangle"])
    surface = fit_surface(mesh)
    figures = {
        "kernels": plot_kernels(),
        "scales": plot_scales(),
        "line": plot_line(),
        "normals": plot_along_normals(mesh, surface),
        "slice": plot_slice(surface),
        "projection": plot_projection(mesh, surface),
    }
    for name, figure in figures.items():
        figure.savefig(options.out / f"rbf_{name}.png", dpi=120, bbox_inches="tight")
        print(options.out / f"rbf_{name}.png")


def plot_kernels():
    """Fig. 2.4: all kernels over r."""
    figure, axes = plt.subplots(1, 2, figsize=(9, 3.2))
    r = np.linspace(0, 2, 400)
    for kernel in KERNELS.values():
        axes[0 if kernel.compact else 1].plot(r, kernel(r), label=kernel.name)
    axes[0].set(title="compact support", xlabel="r", ylabel="phi")
    axes[1].set(title="global", xlabel="r", ylim=(0, 3))
    for ax in axes:
        ax.legend(fontsize=7)
    return figure


def plot_scales():
    """Fig. 2.5: one line of data with different support radii."""
    figure, ax = plt.subplots(figsize=(6, 3))
    x = np.linspace(-1, 5, 400)
    line = np.stack([x, 0 * x, 0 * x], axis=1)
    for radius in (0.5, 1.0, 2.0, 4.0):
        fit = fit_values(SITES, HEIGHTS, support_radius=radius)
        ax.plot(x, fit.value(line), label=f"c = {radius:g}")
    ax.plot(SITES[:, 0], HEIGHTS, "ko", ms=4)
    ax.set(xlabel="x", ylabel="S", title="Wendland C2 (undefined outside the support)")
    ax.legend(fontsize=7)
    return figure


def plot_line():
    """Fig. 2.6: the same data with different kernels (a line does not give the tail of r^3)."""
    figure, ax = plt.subplots(figsize=(6, 3))
    x = np.linspace(-1, 5, 400)
    line = np.stack([x, 0 * x, 0 * x], axis=1)
    for name in ("wendland_c0", "wendland_c2", "wendland_c4", "wendland_c6"):
        fit = fit_values(SITES, HEIGHTS, support_radius=2.0, kernel=name)
        ax.plot(x, fit.value(line), label=name)
    for name in ("gaussian", "multiquadric", "inverse_multiquadric"):
        fit = fit_global(SITES, HEIGHTS, kernel=name, scale=1.0)
        ax.plot(x, fit.value(line), "--", label=name)
    ax.plot(SITES[:, 0], HEIGHTS, "ko", ms=4)
    ax.set(xlabel="x", ylabel="S", ylim=(-0.1, 2.2))
    ax.legend(fontsize=7, loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure


def triangle_frames(mesh, count, seed=0):
    """Centroids and unit normals of some triangles, and their mean edge length."""
    rng = np.random.default_rng(seed)
    corners = mesh.points[mesh.faces[rng.choice(len(mesh.faces), count, replace=False)]]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    return corners.mean(axis=1), normals


def plot_along_normals(mesh, surface):
    """Fig. 3.1: values along the triangles' normals through their centroids."""
    centroids, normals = triangle_frames(mesh, 200)
    figure, ax = plt.subplots(figsize=(6, 3.6))
    steps = np.linspace(-1.5, 1.5, 61) * surface.spacing
    for centroid, normal in zip(centroids, normals):
        values = surface.value(centroid + steps[:, None] * normal)
        ax.plot(steps / surface.spacing, values / surface.spacing, lw=0.4, color="tab:blue")
    ax.plot([-1.5, 1.5], [-1.5, 1.5], "k--", lw=1, label="signed distance")
    ax.set(xlabel="distance along the normal / spacing", ylabel="S / spacing")
    ax.legend()
    return figure


def plot_slice(surface):
    """Fig. 3.3: a slice with seven isolines between -1 and 1 spacing.

    Farther than half the support from the vertices S falls back to 0 and says nothing: left blank.
    """
    low, high = surface.points.min(axis=0), surface.points.max(axis=0)
    pad = 0.5 * surface.support_radius
    x = np.linspace(low[0] - pad, high[0] + pad, 400)
    y = np.linspace(low[1] - pad, high[1] + pad, 400)
    grid = np.meshgrid(x, y)
    middle = np.full(grid[0].size, 0.5 * (low[2] + high[2]))
    places = np.stack([grid[0].ravel(), grid[1].ravel(), middle], axis=1)
    values = surface.value(places) / surface.spacing
    values[surface.distance_to_data(places) > pad] = np.nan
    values = values.reshape(grid[0].shape)
    figure, ax = plt.subplots(figsize=(6, 6))
    levels = np.linspace(-1, 1, 7)
    shades = ax.contourf(*grid, values, levels, cmap="RdBu_r", extend="both", alpha=0.6)
    ax.contour(*grid, values, levels, linewidths=0.7, colors="k")
    ax.contour(*grid, values, [0.0], linewidths=2, colors="k")
    bar = figure.colorbar(shades, label="S / spacing", shrink=0.7, format="%.2g")
    bar.set_ticks(levels)
    ax.set(aspect="equal", xlabel="x", ylabel="y", title="blank: farther than c / 2 from the data")
    return figure


def plot_projection(mesh, surface):
    """Fig. 3.5: |S| over the steps of the projection, gradient renewed always and every third."""
    centroids, _ = triangle_frames(mesh, 400, 1)
    figure, axes = plt.subplots(1, 2, figsize=(9, 3.2), sharey=True)
    for ax, refresh in zip(axes, (1, 3)):
        points = centroids.copy()
        history = [np.abs(surface.value(points))]
        for step in range(8):
            if step % refresh == 0:
                gradient = surface.gradient(points)
            slope2 = np.maximum((gradient**2).sum(axis=1), 0.04)
            points = points - (surface.value(points) / slope2)[:, None] * gradient
            history.append(np.abs(surface.value(points)))
        ax.semilogy(np.array(history) / surface.spacing + 1e-17, lw=0.4, color="tab:blue")
        often = "step" if refresh == 1 else f"{refresh} steps"
        ax.set(xlabel="step", title=f"gradient renewed every {often}")
        ax.axhline(6e-6, color="k", ls="--", lw=1, label="tolerance")
        ax.legend(loc="upper right", fontsize=7)
    axes[0].set(ylabel="|S| / spacing")
    return figure


if __name__ == "__main__":
    main()
