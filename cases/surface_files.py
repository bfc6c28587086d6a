"""surface.stl in millimetres, read back and checked; quality.json."""

from cases.json_file import write_json
from meshes import InvalidMesh
from meshes.closest_point import two_sided_distance
from meshes.io import read_surface, write_surface
from meshes.quality import signed_volume, surface_quality
from meshes.topology import topology

MILLIMETRES = 1000.0  # per metre


def write_stl_checked(path, surface):
    """Write a surface [m] as a binary STL in millimetres, read it back and compare.

    Raises
    ------
    InvalidMesh
        If the file's surface is not closed and manifold though the surface is, or if its
        triangles or its volume are not the surface's.
    """
    write_surface(path, surface, scale=MILLIMETRES)
    stored = read_surface(path)
    wanted = topology(surface.faces, len(surface.points))
    found = topology(stored.faces, len(stored.points))
    names = ("vertices", "faces", "watertight", "nonmanifold_edges", "nonmanifold_vertices")
    for name in names:
        if getattr(found, name) != getattr(wanted, name):
            raise InvalidMesh(
                f"{path}: has {name.replace('_', ' ')} = {getattr(found, name)} where the surface "
                f"has {getattr(wanted, name)}: points nearer than single precision tells apart "
                "became one; use surface.ply, or a longer remesh.edge_length"
            )
    volume = signed_volume(surface) * MILLIMETRES**3
    if abs(signed_volume(stored) - volume) > 1e-5 * abs(volume):
        raise InvalidMesh(f"{path}: holds another volume than the surface; write it again")


def surface_figures(surface, sigma, reference=None):
    """What quality.json says of one surface.

    Parameters
    ----------
    surface : TriMesh [m]
    sigma : float [m]
        Weight of the normals in the 6D angles.
    reference : TriMesh, optional
        The isosurface: volume drift and distances are measured to it. Left out for itself.

    Returns
    -------
    dict
    """
    quality = surface_quality(surface, sigma=sigma).as_dict()
    volume = quality.pop("volume")
    first = ("vertices", "faces", "watertight", "nonmanifold_edges", "nonmanifold_vertices")
    first += ("self_intersecting_faces", "degenerate_faces", "euler", "components", "genus")
    base = volume if reference is None else signed_volume(reference)
    figures = {name: quality.pop(name) for name in first}
    figures |= {"volume_m3": volume, "volume_drift": volume / base - 1.0 if base else None}
    figures |= quality
    if reference is not None:
        rms, largest = two_sided_distance(reference, surface)
        figures["distance_rms"] = rms / reference.diagonal
        figures["distance_max"] = largest / reference.diagonal
    return figures


def write_quality(path, figures):
    """Write quality.json: the figures of each surface by name."""
    write_json(path, figures)
