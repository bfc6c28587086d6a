"""gamma and eps: from the problem, or chosen from the mesh and the loads; is eps resolved?"""

import logging

import numpy as np

from meshes.errors import InvalidCase
from topopt.ginzburg_landau import interface_width

LOG = logging.getLogger("phasemesh")
LEAST_ELEMENTS = 4.0  # across the interface, or the run warns
AUTO_ELEMENTS = 6.0  # across the interface, where eps is chosen
AUTO_PRESSURE = 0.4  # gamma / eps over the elastic energy density expected at the end
LOCAL_EDGES = ((0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3))


def mean_edge_length(mesh, tets=None):
    """Mean length [m] of the edges of tets (k, 4), or of all; each tet counts alike."""
    corners = mesh.points[mesh.tets if tets is None else tets]
    lengths = [np.linalg.norm(corners[:, a] - corners[:, b], axis=1).mean() for a, b in LOCAL_EDGES]
    return float(np.mean(lengths))


def auto_eps(mesh):
    """eps [m] whose interface is crossed by 6 mean edges."""
    return AUTO_ELEMENTS * mean_edge_length(mesh) * np.sqrt(2.0) / np.pi


def auto_gamma(compliance, volume_fraction, domain_volume, eps):
    """gamma [J/m^2] such that gamma / eps is of the order of the final elastic energy density.

    Parameters
    ----------
    compliance : float [J]
        At the start, phi = m everywhere; F m^2 is what the same forces cost in solid bars of the
        same volume. Negative where imposed displacements do the work: then -F / m^2 is what they
        store in solid bars.
    volume_fraction : float
        m.
    domain_volume : float [m^3]
    eps : float [m]

    Raises
    ------
    InvalidCase
        If nothing is loaded.
    """
    if compliance == 0.0:
        raise InvalidCase("gamma: auto needs a load; give gamma a value or add a load or gravity.")
    share = volume_fraction if compliance > 0.0 else volume_fraction**-3
    return AUTO_PRESSURE * eps * abs(compliance) * share / domain_volume


def warn_if_coarse(mesh, eps, phi=None):
    """Log a warning, with the edge length that would do, if too few elements cross the interface.

    Parameters
    ----------
    mesh : TetMesh
    eps : float [m]
    phi : (n,) float array, optional
        Where given, only tets within the interface (mean phi from 0.1 to 0.9) count.

    Returns
    -------
    float
        Elements (mean edges) across pi eps / sqrt(2).
    """
    tets = mesh.tets
    if phi is not None:
        mean = phi[tets].mean(axis=1)
        inside = (mean > 0.1) & (mean < 0.9)
        tets = tets[inside] if np.any(inside) else tets
    edge = mean_edge_length(mesh, tets)
    words = too_coarse(edge, eps, len(mesh.tets))
    if words:
        LOG.warning("%s", words)
    return interface_width(eps) / edge


def too_coarse(edge, eps, tets):
    """One sentence, with the mesh that would do, if too few edges [m] cross the interface of eps.

    Returns
    -------
    str or None
    """
    width = interface_width(eps)
    across = width / edge
    if not across < LEAST_ELEMENTS:
        return None
    count = float(f"{tets * (LEAST_ELEMENTS / across) ** 3:.2g}")
    return (
        f"only {across:.1f} elements (mean edge {edge:.3g} m) cross the interface of {width:.3g} "
        f"m; an edge length of {width / LEAST_ELEMENTS:.2g} m (about {count:,.0f} tets) would give "
        f"{LEAST_ELEMENTS:g}, or a larger eps."
    )


def measured_interface(mesh, geometry, phi):
    """Width [m] between phi = 0.1 and 0.9 that a field really has, and elements across it.

    From the mean slope within the tets whose mean lies in between; a loaded interface is sharper
    than pi eps / sqrt(2).
    """
    corners = phi[mesh.tets]
    mean = corners.mean(axis=1)
    inside = (mean > 0.1) & (mean < 0.9)
    if not np.any(inside):
        return np.nan, np.nan
    slope = np.einsum("ea,eai->ei", corners[inside], geometry.gradients[inside])
    volumes = geometry.volumes[inside]
    width = 0.8 * volumes.sum() / (volumes @ np.linalg.norm(slope, axis=1))
    return float(width), float(width / mean_edge_length(mesh, mesh.tets[inside]))
