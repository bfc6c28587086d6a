"""Slow, obvious twins of the state problem's kernels, and meshes and loads to try them on."""

import numpy as np

from meshes.structured import bcc_box
from meshes.tet_mesh import TetMesh
from topopt.problem import BoundaryConditions, BoxDomain, Material, Problem

LOWER, UPPER = (0.0, 0.0, 0.0), (0.05, 0.015, 0.02)


# --- meshes, loads, fields -------------------------------------------------------------------


def perturbed_box(lower, upper, cells, amount=0.15, seed=0):
    """A BCC box whose inner nodes are moved at random by up to `amount` of a cell."""
    mesh = bcc_box(lower, upper, cells)
    points = mesh.points.copy()
    inner = np.setdiff1d(np.arange(len(points)), mesh.facets)
    size = (np.asarray(upper) - np.asarray(lower)) / cells
    rng = np.random.default_rng(seed)
    points[inner] += amount * size * rng.uniform(-1, 1, (len(inner), 3))
    return TetMesh(points, mesh.tets, mesh.facets, mesh.facet_patch, mesh.patches)


def make_problem(gravity=(0.0, 0.0, 0.0), **material):
    """A problem of which only the material and the gravity matter."""
    domain = BoxDomain(LOWER, UPPER)
    return Problem(domain, (), (), 0.1, material=Material(**material), gravity=gravity)


def conditions(fixed, forces):
    return BoundaryConditions(fixed, forces, {})


def traction_forces(mesh, stress):
    """Nodal forces (n, 3) of the tractions stress @ normal on the whole boundary."""
    a, b, c = (mesh.points[mesh.facets[:, k]] for k in range(3))
    area_normal = np.cross(b - a, c - a) / 2
    forces = np.zeros_like(mesh.points)
    for corner in mesh.facets.T:
        np.add.at(forces, corner, area_normal @ np.asarray(stress).T / 3)
    return forces


def bridge_conditions(mesh):
    """The quarter bridge: symmetry at x = 0 and y = 0, a clamped foot, a load on top."""
    p = mesh.points
    length, _, height = np.ptp(p, axis=0)
    fixed = np.zeros(p.shape, bool)
    fixed[p[:, 0] == 0.0, 0] = True
    fixed[p[:, 1] == 0.0, 1] = True
    fixed[(p[:, 2] == 0.0) & (p[:, 0] >= 0.89 * length)] = True
    forces = np.zeros_like(p)
    top = (p[:, 2] == height) & (p[:, 0] <= 0.2 * length)
    forces[top, 2] = -0.24 / top.sum()
    return conditions(fixed, forces)


def arch(points, eps=0.00175):
    """A phase field like a finished quarter bridge: an arch that carries a deck."""
    x, y, z = points.T
    middle = 0.0175 * (1 - (x / 0.0475) ** 2)
    rib = np.abs(z - middle) / np.sqrt(1 + (2 * 0.0175 * x / 0.0475**2) ** 2) - 0.0016
    rib = np.maximum(rib, y - 0.0045)
    deck = np.maximum(np.maximum(np.abs(z - 0.0187) - 0.0013, x - 0.011), y - 0.011)
    return 0.5 * (1 - np.tanh(3 * np.minimum(rib, deck) / eps))


# --- twins of element loops ------------------------------------------------------------------


def corner_matrix(mesh, e):
    """The inverse of [[1, x], ...] at the four corners: row 1 to 3 of it are the gradients."""
    return np.linalg.inv(np.column_stack([np.ones(4), mesh.points[mesh.tets[e]]]))


def gradients(mesh, e):
    """Gradients (4, 3) of the four hat functions of tet e."""
    return corner_matrix(mesh, e)[1:].T


def displacement_gradient(mesh, displacement, e):
    """grad u (3, 3) on tet e, row i for component i."""
    return displacement[mesh.tets[e]].T @ gradients(mesh, e)


def stress_tensor(strain, material):
    return material.lame_lambda * np.trace(strain) * np.eye(3) + 2 * material.lame_mu * strain


def strain_tensor(mesh, displacement, e):
    grad = displacement_gradient(mesh, displacement, e)
    return (grad + grad.T) / 2


def energy_density(mesh, displacement, material):
    """eps : C : eps on each tet."""
    strains = [strain_tensor(mesh, displacement, e) for e in range(len(mesh.tets))]
    return np.array([np.sum(s * stress_tensor(s, material)) for s in strains])


def von_mises(mesh, displacement, material, factor):
    """Von Mises stress on each tet, by the formula in the stress components."""
    result = []
    for e in range(len(mesh.tets)):
        s = factor[e] * stress_tensor(strain_tensor(mesh, displacement, e), material)
        normal = (s[0, 0] - s[1, 1]) ** 2 + (s[1, 1] - s[2, 2]) ** 2 + (s[2, 2] - s[0, 0]) ** 2
        shear = s[0, 1] ** 2 + s[1, 2] ** 2 + s[2, 0] ** 2
        result.append(np.sqrt(normal / 2 + 3 * shear))
    return np.array(result)


def stiffness(mesh, material, factor, fixed):
    """Dense stiffness matrix (3 n, 3 n): energy of every pair of unit displacements, tet by tet."""
    n = len(mesh.points)
    matrix = np.zeros((n, 3, n, 3))
    for e, tet in enumerate(mesh.tets):
        volume = abs(np.linalg.det(np.column_stack([np.ones(4), mesh.points[tet]]))) / 6
        grads = gradients(mesh, e)
        for a in range(4):
            for i in range(3):
                unit = np.outer(np.eye(3)[i], grads[a])
                stress = factor[e] * volume * stress_tensor((unit + unit.T) / 2, material)
                for b in range(4):
                    matrix[tet[a], i, tet[b]] += stress @ grads[b]
    matrix = matrix.reshape(3 * n, 3 * n)
    held = fixed.ravel()
    keep = np.eye(3 * n, dtype=bool) | ~(held[:, None] | held)
    return np.where(keep, matrix, 0.0)


def mean_cube(phi, tets):
    """Mean of phi^3 by a quadrature rule of degree 3 on the tet (Keast's five points)."""
    corner = np.full((4, 4), 1 / 6) + np.eye(4) * (1 / 2 - 1 / 6)
    values = phi[tets]
    return -0.8 * values.mean(axis=1) ** 3 + 0.45 * ((values @ corner) ** 3).sum(axis=1)


# --- twins of multigrid kernels --------------------------------------------------------------


def aggregate(neighbours, taking_part):
    """Greedy aggregation of a graph given as sets: aggregate of each node, -2 if left out."""
    group, count = {}, 0
    nodes = [i for i in range(len(neighbours)) if taking_part[i]]
    for i in nodes:
        if i not in group and not any(j in group for j in neighbours[i]):
            group.update({j: count for j in neighbours[i] | {i} if taking_part[j]})
            count += 1
    first_pass = dict(group)
    for i in nodes:
        joined = [first_pass[j] for j in sorted(neighbours[i]) if j in first_pass]
        if i not in group and joined:
            group[i] = joined[0]
    for i in nodes:
        if i not in group:
            group.update(
                {j: count for j in neighbours[i] | {i} if taking_part[j] and j not in group}
            )
            count += 1
    return np.array([group.get(i, -2) for i in range(len(neighbours))]), count


def dense(pattern, blocks, n_columns):
    """A block matrix in CSR form as a dense array."""
    b, c = blocks.shape[1:]
    matrix = np.zeros((pattern.rows, b, n_columns, c))
    for row in range(pattern.rows):
        for k in range(int(pattern.indptr[row]), int(pattern.indptr[row + 1])):
            matrix[row, :, pattern.indices[k]] = blocks[k]
    return matrix.reshape(pattern.rows * b, n_columns * c)


def dense_tentative(level, count):
    """T of a level as a dense array."""
    n, b, _ = level.tentative.shape
    matrix = np.zeros((n, b, count, 6))
    for i in range(n):
        if level.aggregates[i] >= 0:
            matrix[i, :, level.aggregates[i]] = level.tentative[i]
    return matrix.reshape(n * b, count * 6)


def block_diagonal(matrix, b):
    """The block diagonal of a dense matrix, as a dense matrix."""
    keep = np.kron(np.eye(len(matrix) // b), np.ones((b, b)))
    return matrix * keep
