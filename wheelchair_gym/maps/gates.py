"""Free cells as runs, the gates among them, and the queue in which gates wait."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.kernel import borrowing_kernel, kernel
from wheelchair_gym.maps.distance import same

Index = NDArray[np.int32]
Mask = NDArray[np.bool_]
Records = NDArray[np.void]

RUN = np.dtype([("first", np.int32), ("last", np.int32)])  # columns
GATE = np.dtype(
    [
        ("row", np.int32),
        ("col", np.int32),
        ("east", np.int32),  # 1 or -1: the blocked corner lies in this column beside it ...
        ("north", np.int32),  # ... and in this row
        ("way", np.float32),  # the shortest so far
        ("root", np.int32),  # the bend that lit it
        ("place", np.int32),  # in the queue, 0 if it does not wait
    ]
)


class Terrain(NamedTuple):
    """Free cells row by row, as runs, and the gates among them."""

    run: Index  # (rows + 1,): the first run of each row
    runs: Records
    gate: Index  # (rows + 1,): the first gate of each row
    gates: Records


@kernel
def terrain_of(free: Mask) -> Terrain:
    """The runs of a map's free cells, and its gates."""
    rows, cols = free.shape
    cells = free.view(np.int8)
    run, gate = np.zeros(rows + 1, np.int32), np.zeros(rows + 1, np.int32)
    alike = np.zeros(rows, np.bool_)  # rows like the one below
    runs = np.empty(rows * ((cols + 1) // 2), RUN)  # as many as there might be: only a few are met
    k = 0
    for row in range(rows):
        run[row] = k
        alike[row] = row > 0 and same(cells[row], cells[row - 1])
        if alike[row]:
            for other in range(run[row - 1], run[row]):
                runs[k].first, runs[k].last = runs[other].first, runs[other].last
                k += 1
            continue
        col = 0
        while col < cols:
            while col < cols and not free[row, col]:
                col += 1
            if col < cols:
                runs[k].first = col
                while col < cols and free[row, col]:
                    col += 1
                runs[k].last = col - 1
                k += 1
    run[rows] = k
    gates = np.empty(4 * k, GATE)
    m = 0
    for row in range(rows):
        gate[row] = m
        for side in (-1, 1):
            beside = row + side
            if beside < 0 or beside >= rows or alike[max(row, beside)]:
                continue
            for k in range(run[beside], run[beside + 1]):
                for way in (-1, 1):
                    col = runs[k].last if way > 0 else runs[k].first
                    if 0 <= col + way < cols and free[row, col] and free[row, col + way]:
                        gates[m].row, gates[m].col = row, col
                        gates[m].east, gates[m].north = way, side
                        gates[m].way, gates[m].place = np.inf, 0
                        m += 1
    gate[rows] = m
    return Terrain(run, runs[: run[rows]], gate, gates[:m])


@borrowing_kernel
def enqueue(gates: Records, queue: Index, gate: int) -> None:
    """Let a gate wait, or move it up as its way became shorter: a heap, queue[0] its length."""
    way, k = gates[gate].way, gates[gate].place
    if k == 0:
        queue[0] += 1
        k = queue[0]
    while k > 1:
        above = queue[k // 2]
        if gates[above].way <= way:
            break
        queue[k] = above
        gates[above].place = k
        k //= 2
    queue[k] = gate
    gates[gate].place = k


@borrowing_kernel
def dequeue(gates: Records, queue: Index) -> int:
    """The gate with the shortest way."""
    top, count = queue[1], queue[0] - 1
    gates[top].place = 0
    queue[0] = count
    if count > 0:
        moved = queue[count + 1]
        k = 1
        while 2 * k <= count:
            below, other = 2 * k, min(2 * k + 1, count)
            if gates[queue[other]].way < gates[queue[below]].way:
                below = other
            if gates[queue[below]].way >= gates[moved].way:
                break
            queue[k] = queue[below]
            gates[queue[k]].place = k
            k = below
        queue[k] = moved
        gates[moved].place = k
    return int(top)


@borrowing_kernel
def run_at(terrain: Terrain, row: int, col: int) -> int:
    """The run that holds a free cell."""
    k = terrain.run[row]
    while terrain.runs[k].last < col:
        k += 1
    return int(k)
