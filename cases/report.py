"""quality.json's figures and the summary that is printed at the end of a run."""

import numpy as np

from cases.surface_files import surface_figures
from cases.targets import sigma_length
from meshes.quality import face_areas
from meshes.roughness import roughness
from topopt.problem import moved


def quality(run):
    """Figures of each surface that the run has made: isosurface, smoothed, surface."""
    if run.isosurface is None:
        return {}
    reference = run.isosurface
    sigma = sigma_length(run.case.remesh.sigma, reference.diagonal)
    found = {"isosurface": surface_figures(reference, sigma)}
    for name in ("smoothed", "surface"):
        surface = getattr(run, name)
        if surface is not None:
            found[name] = surface_figures(surface, sigma, reference)
            rough = roughness(surface, _edge_of_equilateral(run.smoothed))
            found[name]["roughness_deg"] = float(np.degrees(rough))
    return found


def _edge_of_equilateral(surface):
    """Edge length of equilateral triangles of the surface's mean area."""
    return float(np.sqrt(4.0 / np.sqrt(3.0) * face_areas(surface.points, surface.faces).mean()))


def summary(run, figures, manifest):
    """The run in a few lines, for people; all figures are of the whole part."""
    lines = [run.case.title or run.case.name]
    lines += _row("mesh", f"{run.figures['mesh']['tets']:,} tetrahedra")
    if "topopt" in run.figures:
        lines += _design_lines(run)
    for name, row in figures.items():
        lines += _row(name, _surface_line(row))
    lines += _row("time", _times(manifest["stages"]))
    lines += _row("files", str(run.folder))
    return "\n".join(lines)


def _row(name, text):
    return [f"  {name:<22}{text}"]


def _design_lines(run):
    design, copies = run.figures["topopt"], run.copies
    volume = design["material_volume_m3"] * copies
    whole = f" (of the modelled {_share(copies)}: {design['compliance_J']:.4g} J)"
    rows = [
        ("mass", f"{1e3 * volume * run.problem.material.density:.4g} g"),
        ("volume fraction", f"{design['volume_fraction']:.9g}"),
        ("compliance", f"{design['compliance_J'] * copies:.4g} J{whole if copies > 1 else ''}"),
        ("optimisation", f"{_steps(design)}, ended by {_ENDINGS[design['outcome']]}"),
        ("KKT residual", f"{design['kkt']['residual']:.3g}"),
        ("interface", _interface(design)),
        ("largest von Mises", f"{design['largest_von_mises_Pa'] / 1e6:.4g} MPa"),
    ]
    if design.get("too_coarse"):
        rows.append(("MESH TOO COARSE", design["too_coarse"]))
    for case in design["load_cases"]:
        rows += _case_rows(run, case, several=len(design["load_cases"]) > 1)
    return [line for name, text in rows for line in _row(name, text)]


def _steps(design):
    coarse = design.get("coarse_steps", 0)
    return f"{design['steps']} steps" + (f" ({coarse} of them on coarser meshes)" if coarse else "")


def _case_rows(run, case, several):
    """Rows of one load case: its loads' displacements, and the force that imposed ones take."""
    rows, tail = [], f" ({case['name']})" if several else ""
    if several:
        text = f"{case['compliance_J'] * run.copies:.4g} J, weight {case['weight']:g}"
        rows.append((f"load case {case['name']}", text))
    for name, value in case["load_displacement_m"].items():
        rows.append((f"displacement at {name}", f"{1e6 * value:.4g} um along the load{tail}"))
    for support in moved(run.problem.supports):
        force = ", ".join(f"{value:.4g}" for value in case["support_force_N"][support.name])
        rows.append((f"force at {support.name}", f"({force}) N on the modelled part{tail}"))
    return rows


_ENDINGS = {
    "steps": "the number of steps",
    "tolerance": "the KKT residual",
    "stagnation": "stagnation",
    "no_decrease": "no further decrease",
    "interrupted": "an interruption",
}


def _share(copies):
    return {2: "half", 4: "quarter", 8: "eighth"}.get(copies, "part")


def _interface(design):
    width, elements = design["interface_m"], design["elements_across_interface"]
    if width is None or not np.isfinite(width):
        return "none"
    return f"{1e3 * width:.3g} mm wide between phi 0.1 and 0.9, {elements:.2g} elements"


def _surface_line(row):
    closed = "closed" if row["watertight"] else "OPEN"
    text = f"{row['vertices']:,} vertices, {row['faces']:,} triangles, {closed}"
    if row["self_intersecting_faces"]:
        text += f", {row['self_intersecting_faces']} self-intersecting faces"
    text += f", genus {row['genus']}, angles {row['min_angle_mean']:.1f} mean"
    text += f" {row['min_angle_worst']:.1f} worst, volume {1e6 * row['volume_m3']:.4g} cm^3"
    if "distance_rms" in row:
        text += f" ({100 * row['volume_drift']:+.2f} %)"
    return text


def _times(stages):
    parts = [f"{name} {stage['seconds']:.1f} s" for name, stage in stages.items()
             if not stage.get("reused")]  # fmt: skip
    peak = max(stage["peak_memory_mib"] for stage in stages.values())
    return f"{', '.join(parts)}; peak memory {peak:.0f} MiB"
