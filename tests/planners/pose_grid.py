"""The grid of poses of the oracle: which are free, where a chair gets from one to another."""

import math

import numpy as np

from wheelchair_gym.compiled.kernel import kernel
from wheelchair_gym.geometry.planar import point_segment_distance

STEP = 0.03  # m
WIDEST = math.radians(4.0)  # between neighbouring headings
LONGEST = 15  # steps: the longest whole step that gives a heading; 0.64 m, less than a chair
PLAY = 1e-9  # m: overlaps below this are rounding


def grid_headings():
    """Whole steps (k, 2) counter-clockwise, their headings (k,) at most `WIDEST` apart."""
    octant = {(i // math.gcd(i, j), j // math.gcd(i, j))
              for i in range(1, LONGEST + 1) for j in range(i + 1)}  # fmt: skip
    angle = {v: math.atan2(v[1], v[0]) for v in octant}
    chosen = [(1, 0)]
    while chosen[-1] != (1, 1):
        low = angle[chosen[-1]]
        within = [v for v in octant if low + 1e-9 < angle[v] <= low + WIDEST]
        chosen.append(min(within, key=lambda v: (v[0], -angle[v])) if (1, 1) not in within
                      else (1, 1))  # fmt: skip
    eighth = np.array(chosen)
    quarter = np.vstack([eighth, eighth[-2:0:-1, ::-1]])
    turned = [quarter]
    for _ in range(3):
        turned.append(np.stack([-turned[-1][:, 1], turned[-1][:, 0]], axis=1))
    steps = np.vstack(turned)
    return steps, np.arctan2(steps[:, 1], steps[:, 0]) % (2 * math.pi)


@kernel
def _overlaps(px, py, qx, qy, front, rear, half):
    """Return True if a segment in the chair's frame enters the open rectangle (separating axes)."""
    if max(px, qx) <= -rear + PLAY or min(px, qx) >= front - PLAY:
        return False
    if max(py, qy) <= -half + PLAY or min(py, qy) >= half - PLAY:
        return False
    nx, ny = py - qy, qx - px
    size = math.hypot(nx, ny)
    if size == 0.0:
        return True
    middle = 0.5 * (front - rear)
    apart = abs(nx * (middle - px) - ny * py)
    return apart < abs(nx) * 0.5 * (front + rear) + abs(ny) * half - PLAY * size


@kernel
def _between(angle, low, high):
    """Return True if an angle lies in an open range, all modulo a turn."""
    return 0.0 < (angle - low) % (2.0 * math.pi) < high - low


@kernel
def _pivot_hits(px, py, qx, qy, low, high, corners):
    """Return True if turning from `low` to `high` sweeps over a segment (relative to the axle).

    The rectangle is free of it at both headings; so a corner crosses it on the way, or its first
    end comes under a corner (the other end is the next segment's first).
    """
    radius, angle = math.hypot(px, py), math.atan2(py, px)
    for k in range(4):
        cr, ca = math.hypot(corners[k, 0], corners[k, 1]), math.atan2(corners[k, 1], corners[k, 0])
        if radius < cr - PLAY and _between(angle - ca, low, high):
            return True
        ex, ey = qx - px, qy - py
        a, b, c = ex * ex + ey * ey, px * ex + py * ey, px * px + py * py - cr * cr
        root = b * b - a * c
        if a == 0.0 or root <= 0.0:
            continue
        for sign in (-1.0, 1.0):
            t = (-b + sign * math.sqrt(root)) / a
            if 0.0 < t < 1.0:
                hit = math.atan2(py + t * ey, px + t * ex)
                if _between(hit - ca, low, high):
                    return True
    return False


@kernel
def _pose_free(seen, around, heading, inland, x, y, outline, corners, box):
    """Return True if the rectangle at (x, y) is inside and free of edges and discs (relative)."""
    front, rear, half = outline[0], outline[1], outline[2]
    c, s = math.cos(heading), math.sin(heading)
    if not inland:
        for k in range(4):
            u = x + c * corners[k, 0] - s * corners[k, 1]
            v = y + s * corners[k, 0] + c * corners[k, 1]
            if not (box[0] <= u <= box[2] and box[1] <= v <= box[3]):
                return False
    for k in range(seen.shape[0]):
        ax, ay, bx, by = seen[k, 0], seen[k, 1], seen[k, 2], seen[k, 3]
        px, py, qx, qy = c * ax + s * ay, c * ay - s * ax, c * bx + s * by, c * by - s * bx
        if _overlaps(px, py, qx, qy, front, rear, half):
            return False
    for k in range(around.shape[0]):
        dx, dy = around[k, 0], around[k, 1]
        u, v = c * dx + s * dy, c * dy - s * dx
        ux, vy = max(max(u - front, -rear - u), 0.0), max(abs(v) - half, 0.0)
        if math.hypot(ux, vy) < around[k, 2] - PLAY:
            return False
    return True


@kernel
def _pivot_free(seen, around, low, high, inland, x, y, corners, box):
    """Return True if the turn from `low` to `high` is free; the rectangle is free at both."""
    for q in range(4):
        cr, ca = math.hypot(corners[q, 0], corners[q, 1]), math.atan2(corners[q, 1], corners[q, 0])
        if not inland:  # the corner's farthest points to the map's sides
            for side in range(4):
                room = (box[2] - x, box[3] - y, x - box[0], y - box[1])[side]
                if cr > room + PLAY and _between(0.5 * math.pi * side - ca, low, high):
                    return False
        for k in range(around.shape[0]):
            far = math.hypot(around[k, 0], around[k, 1])
            if far - cr < around[k, 2] - PLAY and _between(
                math.atan2(around[k, 1], around[k, 0]) - ca, low, high
            ):
                return False
    for k in range(seen.shape[0]):
        ax, ay, bx, by = seen[k, 0], seen[k, 1], seen[k, 2], seen[k, 3]
        if _pivot_hits(ax, ay, bx, by, low, high, corners):
            return False
    return True


@kernel
def fill(edges, discs, solid, frame, headings, outline, box, poses, pivots):
    """Mark free poses and free pivots to the next heading, (headings, rows, columns)."""
    front, rear, half = outline[0], outline[1], outline[2]
    corners = np.array([(-rear, -half), (front, -half), (front, half), (-rear, half)])
    reach = math.hypot(max(front, rear), half)
    inner = min(min(front, rear), half)
    count = headings.shape[0]
    near, round_ones = np.empty(edges.shape[0], np.int64), np.empty(discs.shape[0], np.int64)
    seen, around = np.empty((edges.shape[0], 4)), np.empty((discs.shape[0], 3))
    for i in range(poses.shape[1]):
        for j in range(poses.shape[2]):
            x, y = frame[0] + j * frame[2], frame[1] + i * frame[2]
            if solid[i, j]:
                continue
            n, m, gap = 0, 0, math.inf
            for k in range(edges.shape[0]):
                ax, ay, bx, by = edges[k, 0], edges[k, 1], edges[k, 2], edges[k, 3]
                d = point_segment_distance(x, y, ax, ay, bx, by)
                gap = min(gap, d)
                if d < reach:
                    near[n] = k
                    n += 1
            for k in range(discs.shape[0]):
                d = math.hypot(discs[k, 0] - x, discs[k, 1] - y) - discs[k, 2]
                gap = min(gap, d)
                if d < reach:
                    round_ones[m] = k
                    m += 1
            if gap < inner - PLAY:
                continue
            inland = min(min(box[2] - x, box[3] - y), min(x - box[0], y - box[1])) > reach
            if inland and n == 0 and m == 0:
                poses[:, i, j] = True
                pivots[:, i, j] = True
                continue
            for k in range(n):
                for axis in range(4):
                    seen[k, axis] = edges[near[k], axis] - (x if axis % 2 == 0 else y)
            for k in range(m):
                dx, dy = discs[round_ones[k], 0] - x, discs[round_ones[k], 1] - y
                around[k, 0], around[k, 1], around[k, 2] = dx, dy, discs[round_ones[k], 2]
            for h in range(count):
                poses[h, i, j] = _pose_free(
                    seen[:n], around[:m], headings[h], inland, x, y, outline, corners, box
                )
            for h in range(pivots.shape[0]):
                after = (h + 1) % count
                low, high = headings[h], headings[after] + (2.0 * math.pi if after == 0 else 0.0)
                pivots[h, i, j] = (
                    poses[h, i, j]
                    and poses[after, i, j]
                    and _pivot_free(seen[:n], around[:m], low, high, inland, x, y, corners, box)
                )


def neighbours(field, i, j):
    """Parts of a field (rows, columns) that lie (i, j) cells apart, cell by cell."""
    rows, columns = field.shape
    begin = field[max(0, -i) : rows - max(0, i), max(0, -j) : columns - max(0, j)]
    end = field[max(0, i) : rows + min(0, i), max(0, j) : columns + min(0, j)]
    return begin, end


def moves(poses, pivots, steps):
    """Pairs (n, 2) of numbers of poses that a move joins, and the translation (n,) of each [m]."""
    numbers = np.arange(poses.size).reshape(poses.shape)
    pairs, ways = [np.stack([numbers[pivots], np.roll(numbers, -1, axis=0)[pivots]])], [0.0]
    for free, number, (j, i) in zip(poses, numbers, steps.tolist(), strict=True):
        both = np.logical_and(*neighbours(free, i, j))
        pairs.append(np.stack([part[both] for part in neighbours(number, i, j)]))
        ways.append(STEP * math.hypot(i, j))
    return np.hstack(pairs).T, np.repeat(ways, [part.shape[1] for part in pairs])
