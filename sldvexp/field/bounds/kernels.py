"""Loops over nodes, samples and pixels that bounds of a large field spend their time in.

They are what `sldvexp.field.bounds.inverse` and `sldvexp.field.equations.elements` compute with
sparse matrices, node by node or triangle by triangle and without these: the pixels of each are
numbered anew, so that all that is summed over them stays in the cache. As Python they would take
hours; `compiled` compiles them.
Numbers are the same but for the order of sums.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sldvexp.typing import Array, IndexArray


def pixels_of_triangles(
    sizes: IndexArray, start: IndexArray, pixel: IndexArray
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """List the pixels that samples over each triangle are interpolated from, in any order.

    Parameters
    ----------
    sizes : ndarray of int, shape (4,)
        Gaps, triangles, points of a prism, pixels.
    start, pixel : ndarray of int
        Pixels of each sample, as of a CSR matrix.

    Returns
    -------
    indptr, indices : ndarray of int
        As of a CSR matrix, shape (triangle, pixel).
    """
    gaps, triangles, points, pixels = sizes
    seen = np.full(pixels, -1, np.int32)
    indptr = np.zeros(triangles + 1, np.int32)
    found = np.empty(16 * triangles + 16, np.int32)
    count = 0
    for triangle in range(triangles):
        for gap in range(gaps):
            sample = (gap * triangles + triangle) * points
            for entry in range(start[sample], start[sample + points]):
                if seen[pixel[entry]] != triangle:
                    seen[pixel[entry]] = triangle
                    if count == len(found):
                        longer = np.empty(2 * count, np.int32)
                        longer[:count] = found
                        found = longer
                    found[count] = pixel[entry]
                    count += 1
        indptr[triangle + 1] = count
    return indptr, found[:count].copy()


def pixels_of_nodes(
    corner_start: IndexArray, corner: IndexArray, pixels: int, start: IndexArray, pixel: IndexArray
) -> tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.int32]]:
    """List the pixels that bear on each node, ascending.

    Parameters
    ----------
    corner_start, corner : ndarray of int
        Corners of triangles, ``3 triangle + corner``, that are at each node, as of a CSR matrix.
    pixels : int
        How many there are.
    start, pixel : ndarray of int
        See `pixels_of_triangles`.

    Returns
    -------
    indptr, indices : ndarray of int
        As of a CSR matrix, shape (node, pixel).
    place : ndarray of int, shape (pixel of a triangle, corner)
        Where those of triangles are among these.
    """
    nodes = len(corner_start) - 1
    entry_of, seen = np.empty(pixels, np.int32), np.full(pixels, -1, np.int32)
    indptr, place = np.zeros(nodes + 1, np.int32), np.empty((len(pixel), 3), np.int32)
    found = np.empty(3 * len(pixel), np.int32)
    count = 0
    for node in range(nodes):
        first = count
        for at in range(corner_start[node], corner_start[node + 1]):
            triangle = corner[at] // 3
            for here in range(start[triangle], start[triangle + 1]):
                if seen[pixel[here]] != node:
                    seen[pixel[here]] = node
                    found[count] = pixel[here]
                    count += 1
        found[first:count].sort()
        indptr[node + 1] = count
        for entry in range(first, count):
            entry_of[found[entry]] = entry
        for at in range(corner_start[node], corner_start[node + 1]):
            triangle, c = corner[at] // 3, corner[at] % 3
            for here in range(start[triangle], start[triangle + 1]):
                place[here, c] = entry_of[pixel[here]]
    return indptr, found[:count].copy(), place


def influences(
    sizes: IndexArray,
    start: IndexArray,
    pixel: IndexArray,
    weight: Array,
    shape: Array,
    estimator: Array,
    near_start: IndexArray,
    near: IndexArray,
    place: IndexArray,
    entries: int,
) -> Array:
    """Compute ``R = sum_s B_s^T (x) T_s W_s``, shape (entry, parameter, layer).

    Triangle by triangle, with all that its three corners get in one row.

    Parameters
    ----------
    weight : ndarray
        Of each sample's pixels.
    shape : ndarray, shape (point, 6)
        Basis functions of a prism at its samples.
    estimator : ndarray, shape (sample, parameter)
        Of the view, T_s.
    near_start, near, place : ndarray of int
        See `pixels_of_triangles`, as the parameters before, and `pixels_of_nodes`.
    entries : int
        Pixels of all nodes.
    """
    gaps, triangles, points, pixels = sizes
    parameters, most = estimator.shape[1], 0
    for triangle in range(triangles):
        most = max(most, near_start[triangle + 1] - near_start[triangle])
    layers, corners = gaps + 1, 3 * parameters
    number = np.empty(pixels, np.int32)
    sums, both = np.empty((most, layers * corners)), np.empty(2 * corners)
    found = np.zeros((entries, parameters, layers))
    for triangle in range(triangles):
        first, last = near_start[triangle], near_start[triangle + 1]
        for at in range(first, last):
            number[near[at]] = at - first
            sums[at - first] = 0.0
        for gap in range(gaps):
            for point in range(points):
                sample = (gap * triangles + triangle) * points + point
                for c in range(6):
                    for p in range(parameters):
                        both[c * parameters + p] = shape[point, c] * estimator[sample, p]
                for entry in range(start[sample], start[sample + 1]):
                    of_both, w = sums[number[pixel[entry]], gap * corners :], weight[entry]
                    for x in range(2 * corners):
                        of_both[x] += w * both[x]
        for at in range(first, last):
            for c in range(3):
                to = found[place[at, c]]
                for layer in range(layers):
                    of_corner = sums[at - first, layer * corners + c * parameters :]
                    for p in range(parameters):
                        to[p, layer] += of_corner[p]
    return found


def coupled_noise(
    row_start: IndexArray,
    row_node: IndexArray,
    row: Array,
    own: IndexArray,
    indptr: IndexArray,
    indices: IndexArray,
    along: Array,
    beside: Array,
    variance: Array,
    most: int,
) -> tuple[Array, Array]:
    """Compute blocks on the diagonals of ``K S K^T`` and the diagonal of ``K S R^T``, ``K = Z R``.

    `scalar_noise` goes the same way with blocks of one number. Loops over the entries of blocks of
    any size in place of both take twice the time.

    Parameters
    ----------
    row_start, row_node, row : ndarray
        The matrix Z in blocks of three by three, as of a BSR matrix, shape (own, patch node).
    own : ndarray of int
        Places of the own nodes in the patch.
    indptr, indices : ndarray of int
        Pixels of the patch's nodes, see `pixels_of_nodes`.
    along, beside : ndarray, shape (entry, 3, layer)
        R with the line's inverse before it, and R; the latter empty if its product is not wanted.
    variance : ndarray, shape (pixel,)
    most : int
        No row of K has more pixels.

    Returns
    -------
    covariance : ndarray, shape (own, 6, layer)
        Entries 00, 10, 11, 20, 21 and 22 of each block.
    fitted : ndarray, shape (3,)
        Summed over the own nodes.
    """
    layers = along.shape[2]
    place, pixel = np.full(len(variance), -1, np.int32), np.empty(most, np.int32)
    covariance, fitted = np.zeros((len(own), 6, layers)), np.zeros(3)
    k = np.empty((most, 3, layers))
    for n in range(len(own)):
        used, total = 0, covariance[n]
        for at in range(row_start[n], row_start[n + 1]):
            z00, z01, z02 = row[at, 0, 0], row[at, 0, 1], row[at, 0, 2]
            z10, z11, z12 = row[at, 1, 0], row[at, 1, 1], row[at, 1, 2]
            z20, z21, z22 = row[at, 2, 0], row[at, 2, 1], row[at, 2, 2]
            for entry in range(indptr[row_node[at]], indptr[row_node[at] + 1]):
                here = place[indices[entry]]
                if here < 0:
                    here, used = used, used + 1
                    place[indices[entry]], pixel[here] = here, indices[entry]
                    k[here] = 0.0
                for x in range(layers):
                    r0, r1, r2 = along[entry, 0, x], along[entry, 1, x], along[entry, 2, x]
                    k[here, 0, x] += z00 * r0 + z01 * r1 + z02 * r2
                    k[here, 1, x] += z10 * r0 + z11 * r1 + z12 * r2
                    k[here, 2, x] += z20 * r0 + z21 * r1 + z22 * r2
        for here in range(used):
            v = variance[pixel[here]]
            for x in range(layers):
                k0, k1, k2 = k[here, 0, x], k[here, 1, x], k[here, 2, x]
                total[0, x] += v * k0 * k0
                total[1, x] += v * k1 * k0
                total[2, x] += v * k1 * k1
                total[3, x] += v * k2 * k0
                total[4, x] += v * k2 * k1
                total[5, x] += v * k2 * k2
        if len(beside):
            for entry in range(indptr[own[n]], indptr[own[n] + 1]):
                here, v = place[indices[entry]], variance[indices[entry]]
                if here >= 0:
                    for p in range(3):
                        for x in range(layers):
                            fitted[p] += v * k[here, p, x] * beside[entry, p, x]
        for here in range(used):
            place[pixel[here]] = -1
    return covariance, fitted


def scalar_noise(
    row_start: IndexArray,
    row_node: IndexArray,
    row: Array,
    own: IndexArray,
    indptr: IndexArray,
    indices: IndexArray,
    along: Array,
    beside: Array,
    variance: Array,
    most: int,
) -> tuple[Array, Array]:
    """Compute as `coupled_noise` does where Z has one number a node, diagonals alone.

    Parameters
    ----------
    along, beside : ndarray, shape (entry, value)
        Values are those of all parameters in all layers.

    Returns
    -------
    nodal : ndarray, shape (own, value)
    fitted : ndarray, shape (value,)
    """
    size = along.shape[1]
    place, pixel = np.full(len(variance), -1, np.int32), np.empty(most, np.int32)
    nodal, fitted = np.zeros((len(own), size)), np.zeros(size)
    k = np.empty((most, size))
    for n in range(len(own)):
        used = 0
        for at in range(row_start[n], row_start[n + 1]):
            z = row[at]
            for entry in range(indptr[row_node[at]], indptr[row_node[at] + 1]):
                here = place[indices[entry]]
                if here < 0:
                    here, used = used, used + 1
                    place[indices[entry]], pixel[here] = here, indices[entry]
                    k[here] = 0.0
                for x in range(size):
                    k[here, x] += z * along[entry, x]
        for here in range(used):
            v = variance[pixel[here]]
            for x in range(size):
                nodal[n, x] += v * k[here, x] * k[here, x]
        if len(beside):
            for entry in range(indptr[own[n]], indptr[own[n] + 1]):
                here, v = place[indices[entry]], variance[indices[entry]]
                if here >= 0:
                    for x in range(size):
                        fitted[x] += v * k[here, x] * beside[entry, x]
        for here in range(used):
            place[pixel[here]] = -1
    return nodal, fitted


def pose_sums(
    where: tuple[IndexArray, Array, int, int],
    mirrors: tuple[Array, float],
    point: Array,
    by_step: Array,
    slope: Array,
    velocity: Array,
    estimator: Array,
    axes: Array,
    balance: Array,
) -> Array:
    """Sum ``B_s^T (T_s (dv - dx . u) + dx (Q r)_k)`` over samples, of one view and its pose.

    Derivatives are as in `sldvexp.field.visibility.pose_slopes`, whose names this has.

    Parameters
    ----------
    where : tuple
        Corners of the triangles, basis functions of a prism, gaps and nodes.
    mirrors : tuple of ndarray and float
        The matrix R, and the mirror offset, m.
    point, by_step : ndarray, shape (sample, 3), m, and (sample, mirror), rad/step
        In the laser frame; the latter NaN where there is no image point.
    slope, velocity : ndarray, shape (mirror, sample, mode) and (sample, 3, mode)
        Of the image by the steps, and u in world axes.
    estimator : ndarray, shape (sample, parameter)
    axes, balance : ndarray, shape (1 or sample, some parameters, 3) and (sample, mode)
        From dD to dx, and ``(Q r)_k``; the latter of no sample where nothing is left.

    Returns
    -------
    ndarray, shape (layer, node, parameter * 6 * mode)
    """
    (corner, shape, gaps, nodes), (r, offset) = where, mirrors
    (samples, parameters), modes, points = estimator.shape, slope.shape[2], len(shape)
    found = np.zeros((gaps + 1, nodes, parameters * 6 * modes))
    change, value = np.empty(6), np.empty((parameters, 6, modes))
    flat = value.reshape(parameters * 6 * modes)
    e, n, c, g, turned = np.empty((2, 3)), np.empty((2, 3)), np.empty(3), np.empty(3), np.empty(3)
    for s in range(samples):
        if np.isnan(by_step[s, 0]):
            continue
        p, gap, triangle = point[s], s // (len(corner) * points), s // points % len(corner)
        radius = np.sqrt(p[1] ** 2 + p[2] ** 2)
        reach = np.sqrt(p[0] ** 2 + (radius + offset) ** 2)
        up, across = (p[1] / radius, p[2] / radius), (p[0] / reach, (radius + offset) / reach)
        d = (across[0], across[1] * up[0], across[1] * up[1])
        e[0, 0], e[0, 1], e[0, 2] = 0.0, up[1], -up[0]
        e[1, 0], e[1, 1], e[1, 2] = across[1], -across[0] * up[0], -across[0] * up[1]
        for i in range(3):
            n[0, i], n[1, i] = e[0, i] * across[1], e[1, i]
            e[0, i], e[1, i] = e[0, i] / radius, e[1, i] / reach  # now A
        for m in range(modes):
            f0, f1 = slope[0, s, m] / by_step[s, 0], slope[1, s, m] / by_step[s, 1]
            for i in range(3):
                u = velocity[s, :, m]
                c[i] = r[i, 0] * u[0] + r[i, 1] * u[1] + r[i, 2] * u[2]
                f0, f1 = f0 + n[0, i] * c[i], f1 + n[1, i] * c[i]
            for i in range(3):
                g[i] = e[0, i] * f0 + e[1, i] * f1
            for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
                change[i] = p[j] * g[k] - p[k] * g[j] - d[j] * c[k] + d[k] * c[j]
                change[3 + i] = -(r[0, i] * g[0] + r[1, i] * g[1] + r[2, i] * g[2])
            for a in range(parameters):
                for x in range(6):
                    value[a, x, m] = estimator[s, a] * change[x]
        for x in range(6 if len(balance) else 0):
            i, j, k = x % 3, (x + 1) % 3, (x + 2) % 3
            if x < 3:  # the mirrors' angles by w, and by t
                f0, f1 = p[j] * e[0, k] - p[k] * e[0, j], p[j] * e[1, k] - p[k] * e[1, j]
            else:
                f0 = -(r[0, i] * e[0, 0] + r[1, i] * e[0, 1] + r[2, i] * e[0, 2])
                f1 = -(r[0, i] * e[1, 0] + r[1, i] * e[1, 1] + r[2, i] * e[1, 2])
            for b in range(3):
                turned[b] = n[0, b] * f0 + n[1, b] * f1
            if x < 3:
                turned[j], turned[k] = turned[j] + d[k], turned[k] - d[j]
            for b in range(3):
                g[b] = -(r[0, b] * turned[0] + r[1, b] * turned[1] + r[2, b] * turned[2])
            for a in range(axes.shape[1]):
                w = axes[s if len(axes) > 1 else 0, a]
                dx = w[0] * g[0] + w[1] * g[1] + w[2] * g[2]
                for m in range(modes):
                    value[a, x, m] += dx * balance[s, m]
        for b in range(6):
            node, weight = corner[triangle, b % 3], shape[s % points, b]
            for x in range(len(flat)):
                found[gap + b // 3, node, x] += weight * flat[x]
    return found
