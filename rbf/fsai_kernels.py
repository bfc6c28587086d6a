"""Compiled loops of the preconditioner: one small Cholesky factorisation per group of sites.

A "site" holds m functionals (1: a value; 2: a value and a scaled normal derivative; 3: the values
of an offset triple). Sites are numbered in the order of the cells; a group is a few consecutive
sites of one cell. The group's rows of the factor come from the block of the system that belongs to
its nearest earlier sites and its own.
"""

import numpy as np
from numba import njit
from numba.extending import overload

from rbf.cell_kernels import MAX_RUNS, ONE, neighbour_runs
from rbf.profiles import LEAN, OPTIONS, wendland_chain, wendland_value
from rbf.sum_kernels import HermiteSum

SUMS = OPTIONS | {"fastmath": {"contract", "nsz", "reassoc"}}
LANES = 8  # rows are padded to a multiple of this
PANEL = 4  # rows that are eliminated at once
# Loops over unsigned indices vectorise; a signed one that might be negative would be wrapped.
UNSIGNED = np.uint64
SMALLEST_PIVOT = 1e-13  # diagonal entries are about 1: a pivot below this is noise


@njit(**OPTIONS)
def choose_columns(first_group, last_group, keys, cells, grid, sites, group_start, columns, counts):
    """The sites each group sees: its nearest earlier ones, then its own.

    Parameters
    ----------
    first_group, last_group : int
        The groups to do.
    keys, cells : int64 arrays
        Packed indices of the occupied cells; the cell of each group.
    grid : tuple
        `CellGrid.arrays` of the sites.
    sites : (n, 3) float array
        In cell order, in units of the support radius.
    group_start : (g + 1,) int64 array
        Group i is the sites group_start[i] to group_start[i + 1].
    columns : (g, neighbours + group size) int32 array
    counts : (g,) int32 array
        How many columns each group has.
    """
    runs, distances = np.empty((MAX_RUNS, 2), np.int64), np.empty(columns.shape[1])
    around = np.full((MAX_RUNS + 1, 2), -1)
    for group in range(first_group, last_group):
        first, last = group_start[group], group_start[group + 1]
        limit = columns.shape[1] - (last - first)
        count = 0
        for run in range(neighbour_runs(keys[cells[group]], ONE, grid, around, runs)):
            for j in range(runs[run, 0], min(runs[run, 1], first)):
                nearest = np.inf
                for i in range(first, last):
                    d = 0.0
                    for axis in range(3):
                        d += (sites[j, axis] - sites[i, axis]) ** 2
                    nearest = min(nearest, d)
                if nearest < 1.0:
                    count = _insert(j, nearest, columns[group], distances[:limit], count)
        for i in range(first, last):
            columns[group, count] = i
            count += 1
        counts[group] = count


@njit(**LEAN)
def _insert(j, distance, chosen, distances, count):
    """Keep the distances.size nearest candidates, sorted; returns how many there are."""
    limit = distances.size
    if limit == 0 or (count == limit and distance >= distances[limit - 1]):
        return count
    place = min(count, limit - 1)
    while place > 0 and distances[place - 1] > distance:
        distances[place], chosen[place] = distances[place - 1], chosen[place - 1]
        place -= 1
    distances[place], chosen[place] = distance, j
    return min(count + 1, limit)


def fill_block(form, scale, ridge, positions, normals, chosen, near, block):
    """The block of the matrix that belongs to some sites, above the diagonal at least."""
    raise NotImplementedError


def _hermite_block(form, scale, ridge, positions, normals, chosen, near, block):
    # 2 x 2 for each pair of sites; lengths in support radii
    for a in range(chosen.size):
        for axis in range(3):
            near[axis, a] = positions[chosen[a], axis]
            near[3 + axis, a] = normals[chosen[a], axis]
    X, Y, Z, NX, NY, NZ = near[0], near[1], near[2], near[3], near[4], near[5]
    for a in range(chosen.size):
        x, y, z, nx, ny, nz = X[a], Y[a], Z[a], NX[a], NY[a], NZ[a]
        upper, lower = block[2 * a], block[2 * a + 1]
        for b in range(a, chosen.size):
            dx, dy, dz = x - X[b], y - Y[b], z - Z[b]
            phi, f1, f2 = wendland_chain(form.profile, dx * dx + dy * dy + dz * dz)
            di = nx * dx + ny * dy + nz * dz
            dj = NX[b] * dx + NY[b] * dy + NZ[b] * dz
            nn = nx * NX[b] + ny * NY[b] + nz * NZ[b]
            upper[2 * b] = phi
            upper[2 * b + 1] = -scale * f1 * dj
            lower[2 * b] = scale * f1 * di
            lower[2 * b + 1] = -scale * scale * (f1 * nn + f2 * di * dj)
        upper[2 * a] += ridge[chosen[a]]


def _value_block(form, scale, ridge, positions, normals, chosen, near, block):
    m = positions.shape[0] // ridge.size  # values of each site
    for a in range(chosen.size * m):
        i = chosen[a // m] * m + a % m
        for b in range(a, chosen.size * m):
            j = chosen[b // m] * m + b % m
            d2 = 0.0
            for axis in range(3):
                d2 += (positions[i, axis] - positions[j, axis]) ** 2
            block[a, b] = wendland_value(form.profile, np.sqrt(d2))
        block[a, a] += ridge[chosen[a // m]]


@overload(fill_block)
def _fill_block(form, scale, ridge, positions, normals, chosen, near, block):
    return _hermite_block if form.instance_class is HermiteSum else _value_block


@njit(**OPTIONS)
def cholesky(block, size, width, inverse_diagonal):
    """Overwrite the upper triangle by U, U^T U = block; returns the number of bad pivots.

    Rows run to `width` (a multiple of LANES; columns from `size` on must be 0) and begin at or
    below the diagonal, so that the loops fill vector registers; what they leave below the diagonal
    is not used. PANEL rows at a time are taken off the rows below them.
    """
    bad, end = 0, UNSIGNED(width)
    for first in range(0, size, PANEL):
        last = min(first + PANEL, size)
        for k in range(first, last):
            for p in range(first, k):
                factor = block[p, k]
                for j in range(UNSIGNED(first), end):
                    block[k, j] -= factor * block[p, j]
            pivot = block[k, k]
            if not pivot > SMALLEST_PIVOT:
                bad += 1
                pivot = 1.0
            inverse_diagonal[k] = 1.0 / np.sqrt(pivot)
            for j in range(UNSIGNED(first), end):
                block[k, j] *= inverse_diagonal[k]
        for i in range(last, size):  # none after the last panel, which may be incomplete
            wa, wb = block[first, i], block[first + 1, i]
            wc, wd = block[first + 2, i], block[first + 3, i]
            for j in range(UNSIGNED(i // LANES * LANES), end):
                block[i, j] -= (
                    wa * block[first, j]
                    + wb * block[first + 1, j]
                    + wc * block[first + 2, j]
                    + wd * block[first + 3, j]
                )
    return bad


@njit(**OPTIONS)
def last_inverse_rows(block, size, wanted, inverse_diagonal, inverse):
    """The last `wanted` rows of the inverse of U^T, as columns of `inverse`, padded to LANES."""
    padded = UNSIGNED((wanted + LANES - 1) // LANES * LANES)
    for k in range(size - 1, -1, -1):
        for u in range(padded):
            inverse[k, u] = 0.0
        if k >= size - wanted:
            inverse[k, k - (size - wanted)] = 1.0
        singles = k + 1 + (size - k - 1) % PANEL
        for j in range(k + 1, singles):
            for u in range(padded):
                inverse[k, u] -= block[k, j] * inverse[j, u]
        for j in range(singles, size, PANEL):
            wa, wb, wc, wd = block[k, j], block[k, j + 1], block[k, j + 2], block[k, j + 3]
            for u in range(padded):
                inverse[k, u] -= (
                    wa * inverse[j, u]
                    + wb * inverse[j + 1, u]
                    + wc * inverse[j + 2, u]
                    + wd * inverse[j + 3, u]
                )
        for u in range(padded):
            inverse[k, u] *= inverse_diagonal[k]


@njit(**OPTIONS)
def factor_groups(
    first_group,
    last_group,
    form,
    scale,
    ridge,
    m,
    positions,
    normals,
    group_start,
    columns,
    counts,
    offsets,
    entries,
    bad,
):
    """The rows of the approximate inverse factor.

    Parameters
    ----------
    first_group, last_group : int
        The groups to do.
    form : HermiteSum or ValueSum
    scale, m : float, int
        The scale of the derivative functional, the functionals per site.
    ridge : (n,) float array
        Added to the diagonal of the values of each site.
    positions : (n m, 3) float array
        Where each functional sits (for Hermite sites: (n, 3)), in units of the support radius.
    normals : (n, 3) float array, or (0, 3)
        Hermite sites have them.
    group_start, columns, counts : arrays
        See `choose_columns`.
    offsets : (g,) int64 array
        Where each group's dense rows begin in `entries`.
    entries : float32 array
        Rows of group i: (sites of the group * m, counts[i] * m).
    bad : (g,) int64 array
        Number of bad pivots of each group.
    """
    largest = (columns.shape[1] * m + LANES - 1) // LANES * LANES
    block, inverse = np.empty((largest, largest)), np.empty((largest, largest))
    inverse_diagonal, near = np.empty(largest), np.empty((6, columns.shape[1]))
    for group in range(first_group, last_group):
        size = counts[group] * m
        wanted = (group_start[group + 1] - group_start[group]) * m
        width = (size + LANES - 1) // LANES * LANES
        for k in range(width):
            for j in range(width):
                block[k, j] = 0.0
        chosen = columns[group, : counts[group]]
        fill_block(form, scale, ridge, positions, normals, chosen, near, block)
        bad[group] = cholesky(block, size, width, inverse_diagonal)
        last_inverse_rows(block, size, wanted, inverse_diagonal, inverse)
        for u in range(wanted):
            for k in range(size):
                entries[offsets[group] + u * size + k] = inverse[k, u]


@njit(**SUMS)
def apply_rows(
    first_group,
    last_group,
    m,
    group_start,
    columns,
    counts,
    offsets,
    entries,
    x,
    products,
    product_start,
):
    """y = G x, and the pieces of G^T y that each group contributes.

    `products` holds, from product_start[i], the counts[i] * m contributions of group i; nobody
    else writes there. `sum_products` adds them up.
    """
    local = np.empty(columns.shape[1] * m, np.float32)
    for group in range(first_group, last_group):
        size = counts[group] * m
        for a in range(counts[group]):
            for v in range(m):
                local[a * m + v] = x[columns[group, a], v]
        place, entry = UNSIGNED(product_start[group]), UNSIGNED(offsets[group])
        width = UNSIGNED(size)
        for k in range(width):
            products[place + k] = 0.0
        for _ in range((group_start[group + 1] - group_start[group]) * m):
            total = np.float32(0.0)
            for k in range(width):
                total += entries[entry + k] * local[k]
            for k in range(width):
                products[place + k] += entries[entry + k] * total
            entry += width


@njit(**OPTIONS)
def list_products(m, columns, counts, product_start, starts, places):
    """For each site, where its contributions lie in `products`: places[starts[j]:starts[j + 1]]."""
    for group in range(counts.size):
        for a in range(counts[group]):
            starts[columns[group, a] + 1] += 1
    for j in range(starts.size - 1):
        starts[j + 1] += starts[j]
    following = starts[:-1].copy()
    for group in range(counts.size):
        for a in range(counts[group]):
            j = columns[group, a]
            places[following[j]] = product_start[group] + a * m
            following[j] += 1


@njit(**OPTIONS)
def sum_products(first_site, last_site, m, starts, places, products, z):
    """z (n, m): the contributions of all groups to each site, always in the same order."""
    for j in range(first_site, last_site):
        for v in range(m):
            total = 0.0
            for e in range(starts[j], starts[j + 1]):
                total += products[places[e] + v]
            z[j, v] = total
