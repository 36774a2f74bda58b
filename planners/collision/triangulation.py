"""Free space as triangles between the corners of obstacles, with the neighbours of each.

One sweep over the corners from low to high (Hertel and Mehlhorn 1983). Each free stretch of the
sweep line has a chain of corners, below which all is triangles; a new corner is joined to all
corners of the chain that it sees. Corners at one height come from left to right; every choice is an
exact sign.
"""

from typing import NamedTuple

import numpy as np

from planners.collision.boundary import NONE, Boundary, group_by_point, orientation
from planners.collision.polygon_tests import Index
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.compiled.kernel import absorbed_kernel, borrowing_kernel, kernel


class Mesh(NamedTuple):
    """Triangles that fill free space; where two free parts meet in a point, they share it."""

    points: Array  # (m, 2) m: corners of obstacles, by y, then x
    corners: Index  # (t, 3) points, counter-clockwise
    across: Index  # (t, 3) 3 * triangle + side beyond the side from each corner on; NONE: solid
    boxes: Array  # (4, t) m: least and greatest x, least and greatest y of each triangle
    first: Index  # (m + 1,) where each point's triangles begin in `around`
    around: Index  # (3 t,) 3 * triangle + corner, point by point


class _Sweep(NamedTuple):
    """Arrays that grow while the sweep line moves up."""

    points: Array  # (m, 2)
    corners: Index  # (2 n, 3)
    across: Index  # (2 n, 3)
    place: Index  # (nodes,) point of each link of a chain
    left: Index  # (nodes,) the link before it, or NONE
    right: Index  # (nodes,)
    edge: Index  # (nodes,) the edge to the link on its right
    waiting: Index  # (edges,) the first triangle beside an edge, 3 * triangle + side, or NONE
    used: Index  # (3,) triangles, links and edges so far


@borrowing_kernel
def _link(sweep: _Sweep, point: int) -> int:
    """Return a new link, not yet in a chain."""
    k = sweep.used[1]
    sweep.used[1] += 1
    sweep.place[k], sweep.left[k], sweep.right[k] = point, NONE, NONE
    return int(k)


@borrowing_kernel
def _edge(sweep: _Sweep) -> int:
    k = sweep.used[2]
    sweep.used[2] += 1
    sweep.waiting[k] = NONE
    return int(k)


@borrowing_kernel
def _beside(sweep: _Sweep, edge: int, code: int) -> None:
    """Add a triangle's side to an edge: the second side becomes the first one's neighbour."""
    other = sweep.waiting[edge]
    if other == NONE:
        sweep.waiting[edge] = code
    else:
        sweep.across[code // 3, code % 3] = other
        sweep.across[other // 3, other % 3] = code


@borrowing_kernel
def _fill(sweep: _Sweep, a: int, b: int, p: int, from_left: int, from_right: int) -> None:
    """Add the triangle of links a, b and a point; its edges to a and to b are given."""
    t = sweep.used[0]
    sweep.used[0] += 1
    sweep.corners[t, 0], sweep.corners[t, 1] = sweep.place[a], sweep.place[b]
    sweep.corners[t, 2] = p
    sweep.across[t, 0] = sweep.across[t, 1] = sweep.across[t, 2] = NONE
    _beside(sweep, sweep.edge[a], 3 * t)
    _beside(sweep, from_right, 3 * t + 1)
    _beside(sweep, from_left, 3 * t + 2)


@borrowing_kernel
def _join(sweep: _Sweep, link: int, p: int, edge: int, rightward: bool) -> int:
    """Add triangles from a point to a chain, from a link on to one side; return its new end."""
    ahead, back = (sweep.right, sweep.left) if rightward else (sweep.left, sweep.right)
    while ahead[link] != NONE:
        a, b = (link, ahead[link]) if rightward else (ahead[link], link)
        if orientation(sweep.points, sweep.place[a], sweep.place[b], p) <= 0.0:
            break  # the point does not see their edge from above
        beyond = _edge(sweep)
        _fill(sweep, a, b, p, edge if rightward else beyond, beyond if rightward else edge)
        link, edge = ahead[link], beyond
    new = _link(sweep, p)
    ahead[new], back[link] = link, new
    sweep.edge[new if rightward else link] = edge
    return new


@borrowing_kernel
def _where(points: Array, low: Index, high: Index, status: Index, count: int, p: int) -> int:
    """Return the number of sides on the sweep line that lie left of a point."""
    first, last = 0, count
    while first < last:
        middle = (first + last) // 2
        if orientation(points, low[status[middle]], high[status[middle]], p) < 0.0:
            first = middle + 1
        else:
            last = middle
    return first


class _Chains(NamedTuple):
    """The chain of each free stretch of the line, by the side on its left."""

    head: Index  # (n,) the left end
    tail: Index  # (n,) the right end
    last: Index  # (n,) the latest link


@absorbed_kernel
def _split_stretch(sweep: _Sweep, chains: _Chains, left: int, right: int, p: int) -> None:
    """Split a free stretch at a point where something solid begins; `right` is its right side."""
    head, tail, last = chains
    q, edge = last[left], _edge(sweep)
    rest = sweep.right[q]
    twin = _link(sweep, sweep.place[q])  # the latest link belongs to both chains
    sweep.right[twin], sweep.edge[twin] = rest, sweep.edge[q]
    if rest != NONE:
        sweep.left[rest] = twin
    end = tail[left] if tail[left] != q else twin
    tail[left] = last[left] = _join(sweep, q, p, edge, False)
    head[right] = last[right] = _join(sweep, twin, p, edge, True)
    tail[right] = end


@absorbed_kernel
def _join_stretches(
    sweep: _Sweep, chains: _Chains, left: int, below: int, above: int, p: int
) -> None:
    """Join a point where sides end to the free stretches beside it.

    They are given by the sides on their left: the stretch on the left of the point, and the one on
    its right below and above it, or NONE. Without a side above, the two stretches become one.
    """
    head, tail, last = chains
    mine = NONE
    if left != NONE:
        mine = _join(sweep, tail[left], p, _edge(sweep), False)
        tail[left] = last[left] = mine
    if below == NONE:
        return
    other = _join(sweep, head[below], p, _edge(sweep), True)
    end = tail[below]
    if above != NONE:
        head[above] = last[above] = other
        tail[above] = end
    else:
        rest = sweep.right[other]
        sweep.right[mine], sweep.edge[mine] = rest, sweep.edge[other]
        sweep.left[rest] = mine
        tail[left] = end


@kernel
def triangulate(
    points: Array, begins: Index, ends: Index
) -> tuple[Index, Index, Index, Index, bool]:
    """Return triangles between closed loops of segments; points (m, 2) are sorted by y, then x.

    Returns corners and neighbours (t, 3), the triangles around each point (see `Mesh`), and whether
    the loops are closed and never cross.
    """
    n, m = begins.shape[0], points.shape[0]
    sweep = _Sweep(
        points,
        np.empty((2 * n + 8, 3), np.int64),
        np.empty((2 * n + 8, 3), np.int64),
        np.empty(6 * n + 8, np.int64),
        np.empty(6 * n + 8, np.int64),
        np.empty(6 * n + 8, np.int64),
        np.empty(6 * n + 8, np.int64),
        np.empty(8 * n + 8, np.int64),
        np.zeros(3, np.int64),
    )
    low, high = np.minimum(begins, ends), np.maximum(begins, ends)
    up = begins < ends  # free space lies on its right
    arrive_first, _ = group_by_point(high, m)
    leave_first, leave = group_by_point(low, m)
    chains = _Chains(np.empty(n, np.int64), np.empty(n, np.int64), np.empty(n, np.int64))
    head, tail, last = chains
    status, count, good = np.empty(n, np.int64), 0, True
    for p in range(m):
        below = arrive_first[p + 1] - arrive_first[p]
        new = leave[leave_first[p] : leave_first[p + 1]]
        above = new.shape[0]
        at = _where(points, low, high, status, count, p)
        if at + below > count or count - below + above > n:
            good = False
            break
        for k in range(at, at + below):
            good &= high[status[k]] == p
        for i in range(1, above):  # from left to right
            for j in range(i, 0, -1):
                if orientation(points, p, high[new[j - 1]], high[new[j]]) <= 0.0:
                    break
                new[j - 1], new[j] = new[j], new[j - 1]
        free_left = at > 0 and up[status[at - 1]]
        free_right = at + below < count and not up[status[at + below]]
        begin = 1 if free_left else 0
        for k in range(below):  # free and solid take turns
            good &= up[status[at + k]] == (k % 2 == begin)
        for k in range(above):
            good &= up[new[k]] == (k % 2 == begin)
        good &= (below + above) % 2 == 0 and free_right == (free_left ^ (below % 2 == 1))
        if not good:
            break
        for k in range(at + begin, at + below - 1, 2):  # free stretches that end here
            _join(sweep, head[status[k]], p, _edge(sweep), True)
        if below > 0:
            _join_stretches(
                sweep, chains,
                status[at - 1] if free_left else NONE,
                status[at + below - 1] if free_right else NONE,
                new[above - 1] if above > 0 else NONE, p,
            )  # fmt: skip
        elif free_left:
            _split_stretch(sweep, chains, status[at - 1], new[above - 1], p)
        for k in range(begin, above - 1, 2):  # free stretches that begin here
            head[new[k]] = tail[new[k]] = last[new[k]] = _link(sweep, p)
        status[at + above : count - below + above] = status[at + below : count]
        status[at : at + above] = new
        count += above - below
    total = sweep.used[0]
    corners = sweep.corners[:total].copy()
    first, around = group_by_point(corners.ravel(), m)
    return corners, sweep.across[:total].copy(), first, around, good and count == 0


def mesh(boundary: Boundary) -> Mesh:
    """Return the triangles of free space.

    Raises:
        ValueError: the segments do not form loops, or they cross.
    """
    points = boundary.points
    corners, across, first, around, good = triangulate(points, boundary.begins, boundary.ends)
    if not good:
        raise ValueError("the boundary of what is free is not made of loops that never cross")
    x, y = points[corners].transpose(2, 1, 0)  # (3, t) each
    boxes = np.array([x.min(axis=0), x.max(axis=0), y.min(axis=0), y.max(axis=0)])
    return Mesh(points, corners, across, boxes, first, around)
