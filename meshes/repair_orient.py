"""Faces turned until neighbours agree, and closed pieces until their normals point outside."""

import numpy as np

from meshes.edges import components, edge_table, face_components
from meshes.errors import InvalidMesh
from meshes.soup import opposite_ends
from meshes.topology import volume_sign, winding_number


def orient_alike(soup, strict=True):
    """Turn the smaller part of every piece whose faces disagree.

    Parameters
    ----------
    soup : Soup
    strict : bool
        Whether a one-sided piece is refused; its faces are left as they are if not.

    Returns
    -------
    Soup

    Raises
    ------
    InvalidMesh
        If a piece has but one side, as a Moebius strip.
    """
    faces = soup.faces
    table = edge_table(faces)
    inner, pairs = table.face_pairs()
    start = table.start[inner]
    first, _ = opposite_ends(faces, table.half_edges[start])
    second, _ = opposite_ends(faces, table.half_edges[start + 1])
    differ = (first == second).astype(np.int64)
    if not differ.any():
        return soup
    count = len(faces)  # node f: face as it is; node f + count: turned
    f, g = pairs.astype(np.int64).T
    rows = np.concatenate([f, f + count])
    columns = np.concatenate([g + count * differ, g + count * (1 - differ)])
    _, side = components(rows, columns, 2 * count)
    one_sided = side[:count] == side[count:]
    if one_sided.any() and strict:
        raise InvalidMesh(
            f"{np.count_nonzero(one_sided)} faces belong to a surface with only one side (as a "
            "Moebius strip), which cannot be oriented: cut it open"
        )
    # Both sides of a piece have as many faces; the one with more faces as they are is kept.
    as_is = np.bincount(side[:count], minlength=int(side.max()) + 1)
    turned = as_is[side[:count]] < as_is[side[count:]]
    tie = as_is[side[:count]] == as_is[side[count:]]
    turned |= tie & (side[:count] > side[count:])
    turned &= ~one_sided
    return soup.turn(turned)


def orient_outward(soup):
    """Turn closed pieces inside out where they are.

    The outermost pieces get their normals outside, and what lies in them turns with them. Pieces
    with faces that were turned get theirs by how deep they lie: the wall of a cavity looks inward.

    Returns
    -------
    Soup
    pieces : int
        Closed pieces turned.
    """
    members = _closed_pieces(soup.faces)
    if len(members) == 0:
        return soup, 0
    corners = [soup.points[soup.faces[chosen]] for chosen in members]
    signs = np.array([volume_sign(triangles) for triangles in corners])
    inside = _containers(corners)
    unsure = np.array([soup.turned[chosen].any() for chosen in members])
    turn = np.zeros(len(members), dtype=bool)
    for number in np.argsort([len(around) for around in inside], kind="stable"):
        around = inside[number]
        if len(around) == 0:
            turn[number] = signs[number] < 0
        elif unsure[number]:
            turn[number] = signs[number] * (-1) ** len(around) < 0
        else:
            outermost = min(around, key=lambda other: len(inside[other]))
            turn[number] = turn[outermost] and not unsure[outermost]
    chosen = np.zeros(len(soup.faces), dtype=bool)
    for number in np.flatnonzero(turn):
        chosen[members[number]] = True
    return soup.turn(chosen), int(turn.sum())


def _closed_pieces(faces):
    """The faces of each closed piece: a list of index arrays."""
    table = edge_table(faces)
    count, piece = face_components(faces)
    closed = np.ones(count, dtype=bool)
    closed[piece[(table.count[table.face_edges] != 2).any(axis=1)]] = False
    order = np.argsort(piece, kind="stable")
    groups = np.split(order, np.searchsorted(piece[order], np.arange(1, count)))
    return [group for group, good in zip(groups, closed) if good]


def _containers(corners):
    """For each piece, given by its triangles, the numbers of those around it."""
    low = np.array([triangles.min(axis=(0, 1)) for triangles in corners])
    high = np.array([triangles.max(axis=(0, 1)) for triangles in corners])
    result = []
    for number, triangles in enumerate(corners):
        point = triangles[0, 0]
        near = np.flatnonzero(np.all((point > low) & (point < high), axis=1))
        result.append(
            [k for k in near if k != number and abs(winding_number(point, corners[k])) > 0.5]
        )
    return result
