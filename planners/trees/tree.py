"""The tree of a planner: its nodes, and a grid of cells for queries.

The grid answers 'nearest' and 'within a radius'. As the tree grows, its cells are halved whenever
there are six nodes per cell on average.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.base.arrays import Array
from wheelchair_gym.compiled.kernel import borrowing_kernel, kernel

NONE = -1  # no node

NODE = np.dtype(
    [
        ("x", np.float64),  # m
        ("y", np.float64),
        ("cost", np.float64),  # m, along the tree from its root
        ("edge", np.float64),  # m, from the parent
        ("parent", np.int32),
        ("child", np.int32),  # the first of the children,
        ("sibling", np.int32),  # and the next child of the same parent
        ("following", np.int32),  # the next node in the same cell
    ]
)
GRID = np.dtype(
    [
        ("x", np.float64),  # m, lower left corner
        ("y", np.float64),
        ("width", np.float64),
        ("height", np.float64),
        ("cell", np.float64),  # m
        ("cols", np.int64),
        ("rows", np.int64),
        ("count", np.int64),  # nodes in the tree
    ]
)


class Tree(NamedTuple):
    """Nodes, the grid cells that hold them, and the shape of the grid."""

    nodes: NDArray[Any]  # (capacity,) NODE
    heads: NDArray[np.int32]  # the first node of each cell
    grid: NDArray[Any]  # (1,) GRID


def new_tree(bounds: Array, capacity: int) -> Tree:
    """Return an empty tree of at most `capacity` nodes.

    Its bounds (4,) [m] are xmin, ymin, xmax, ymax. `np.empty` touches no memory, so that capacity
    costs no time.
    """
    width, height = float(bounds[2] - bounds[0]), float(bounds[3] - bounds[1])
    cell = max(width, height) / 4.0
    grid = np.zeros(1, GRID)
    cols, rows = int(width / cell) + 1, int(height / cell) + 1
    grid[0] = (bounds[0], bounds[1], width, height, cell, cols, rows, 0)
    # Room for all cells: they are halved at six nodes per cell on average.
    heads = np.empty(4 * (cols + 1) * (rows + 1) + 8 * capacity, np.int32)
    heads[: cols * rows] = NONE
    return Tree(np.empty(capacity, NODE), heads, grid)


@borrowing_kernel
def cell_of(grid: Any, x: float, y: float) -> tuple[int, int]:
    """Return column and row of a point's cell; a point outside belongs to the nearest cell."""
    col = min(max(int((x - grid.x) / grid.cell), 0), grid.cols - 1)
    row = min(max(int((y - grid.y) / grid.cell), 0), grid.rows - 1)
    return col, row


@borrowing_kernel
def refine_grid(tree: Tree) -> None:
    """Halve the cells and sort all nodes into them again."""
    nodes, heads, grid = tree.nodes, tree.heads, tree.grid[0]
    grid.cell = 0.5 * grid.cell
    grid.cols = int(grid.width / grid.cell) + 1
    grid.rows = int(grid.height / grid.cell) + 1
    heads[: grid.cols * grid.rows] = NONE
    for i in range(grid.count):
        col, row = cell_of(grid, nodes[i].x, nodes[i].y)
        k = row * grid.cols + col
        nodes[i].following = heads[k]
        heads[k] = i


@borrowing_kernel
def append_child(nodes: NDArray[Any], i: int, parent: int) -> None:
    """Make node i, which has no parent, the child of a node, in a tree of any records."""
    nodes[i].parent = parent
    nodes[i].sibling = nodes[parent].child
    nodes[parent].child = i


@borrowing_kernel
def add_child(tree: Tree, i: int, parent: int, edge: float) -> None:
    """Make node i, which has no parent, the child of a node at a distance of `edge` [m]."""
    tree.nodes[i].edge = edge
    tree.nodes[i].cost = tree.nodes[parent].cost + edge
    append_child(tree.nodes, i, parent)


@borrowing_kernel
def place_node(tree: Tree, i: int, x: float, y: float, parent: int, edge: float) -> None:
    """Write a point [m] into slot i as the child of a parent (NONE for the root)."""
    nodes, heads, grid = tree.nodes, tree.heads, tree.grid[0]
    nodes[i].x = x
    nodes[i].y = y
    nodes[i].child = NONE
    nodes[i].sibling = NONE
    nodes[i].parent = NONE
    nodes[i].edge = 0.0
    nodes[i].cost = 0.0
    if parent != NONE:
        add_child(tree, i, parent, edge)
    col, row = cell_of(grid, x, y)
    k = row * grid.cols + col
    nodes[i].following = heads[k]
    heads[k] = i


@borrowing_kernel
def add_slot(tree: Tree) -> int:
    """Return the index of a new node, which `place_node` writes."""
    grid = tree.grid[0]
    if grid.count >= 6 * grid.cols * grid.rows:
        refine_grid(tree)
    grid.count += 1
    return int(grid.count - 1)


@borrowing_kernel
def insert(tree: Tree, x: float, y: float, parent: int, edge: float) -> int:
    """Add a point [m] as the child of a parent (NONE for the root); return its index."""
    i = add_slot(tree)
    place_node(tree, i, x, y, parent, edge)
    return i


@borrowing_kernel
def remove_child(nodes: NDArray[Any], i: int) -> None:
    """Remove node i from its parent's children, in a tree of any records."""
    parent = nodes[i].parent
    if nodes[parent].child == i:
        nodes[parent].child = nodes[i].sibling
        return
    k = nodes[parent].child
    while nodes[k].sibling != i:
        k = nodes[k].sibling
    nodes[k].sibling = nodes[i].sibling


@borrowing_kernel
def remove_node(tree: Tree, i: int) -> None:
    """Remove a leaf other than the root; `place_node` must refill its slot before `add_slot`."""
    nodes, heads, grid = tree.nodes, tree.heads, tree.grid[0]
    remove_child(nodes, i)
    col, row = cell_of(grid, nodes[i].x, nodes[i].y)
    cell = row * grid.cols + col
    if heads[cell] == i:
        heads[cell] = nodes[i].following
        return
    k = heads[cell]
    while nodes[k].following != i:
        k = nodes[k].following
    nodes[k].following = nodes[i].following


@borrowing_kernel
def nearest(tree: Tree, x: float, y: float) -> int:
    """Return the node nearest to a point [m], found ring by ring of grid cells."""
    nodes, heads, grid = tree.nodes, tree.heads, tree.grid[0]
    cell, cols, rows = grid.cell, grid.cols, grid.rows
    col, row = cell_of(grid, x, y)
    u, v = x - grid.x - col * cell, y - grid.y - row * cell
    inside = max(0.0, min(min(u, cell - u), min(v, cell - v)))
    best, found = np.inf, NONE
    for ring in range(max(cols, rows)):
        for r in range(max(0, row - ring), min(rows - 1, row + ring) + 1):
            stride = 1 if abs(r - row) == ring else 2 * ring
            for c in range(col - ring, col + ring + 1, max(stride, 1)):
                if c < 0 or c >= cols:
                    continue
                i = heads[r * cols + c]
                while i != NONE:
                    square = (nodes[i].x - x) ** 2 + (nodes[i].y - y) ** 2
                    if square < best:
                        best, found = square, i
                    i = nodes[i].following
        if best <= (inside + ring * cell) ** 2:
            break
    return int(found)


@borrowing_kernel
def nodes_within(
    tree: Tree, x: float, y: float, radius: float, found: NDArray[np.int32], distances: Array
) -> int:
    """Write the nodes within a radius [m] of a point and their distances; return their number.

    At most `len(found)` nodes are written.
    """
    nodes, heads, grid = tree.nodes, tree.heads, tree.grid[0]
    left, low = cell_of(grid, x - radius, y - radius)
    right, high = cell_of(grid, x + radius, y + radius)
    n = 0
    for r in range(low, high + 1):
        for c in range(left, right + 1):
            i = heads[r * grid.cols + c]
            while i != NONE:
                square = (nodes[i].x - x) ** 2 + (nodes[i].y - y) ** 2
                if square <= radius * radius and n < len(found):
                    found[n] = i
                    distances[n] = math.sqrt(square)
                    n += 1
                i = nodes[i].following
    return n


@borrowing_kernel
def write_descendants(nodes: NDArray[Any], i: int, out: NDArray[Any]) -> int:
    """Write node i and all nodes below it, parents first; return their number."""
    out[0], n, k = i, 1, 0
    while k < n:
        child = nodes[out[k]].child
        while child != NONE:
            out[n], n = child, n + 1
            child = nodes[child].sibling
        k += 1
    return n


@borrowing_kernel
def change_parent(tree: Tree, i: int, parent: int, edge: float, below: NDArray[np.int32]) -> None:
    """Give node i, not the root, another parent at distance `edge`; update descendants' costs.

    The caller has tested that the edge is free, that it is a gain, and that the parent is no
    descendant of i. `below` is scratch memory for as many indices as the tree has nodes.
    """
    nodes = tree.nodes
    remove_child(nodes, i)
    add_child(tree, i, parent, edge)
    for k in range(1, write_descendants(nodes, i, below)):
        node = nodes[below[k]]
        node.cost = nodes[node.parent].cost + node.edge


@kernel
def edges(tree: Tree) -> Array:
    """Return the edges (k, 4) [m] of a tree: x and y of the parent, then of the child."""
    nodes, count = tree.nodes, tree.grid[0].count
    out = np.empty((count, 4))
    k = 0
    for i in range(count):
        parent = nodes[i].parent
        if parent != NONE:
            out[k, 0], out[k, 1] = nodes[parent].x, nodes[parent].y
            out[k, 2], out[k, 3] = nodes[i].x, nodes[i].y
            k += 1
    return out[:k]


@borrowing_kernel
def write_ancestors(nodes: NDArray[Any], i: int, out: NDArray[Any]) -> int:
    """Write node i and its ancestors up to the root; return their number, at most `len(out)`."""
    n = 0
    while i != NONE and n < len(out):
        out[n] = i
        n += 1
        i = nodes[i].parent
    return n


@kernel
def path_from_root(tree: Tree, i: int) -> Array:
    """Return the path (n, 2) [m] from the root to node i."""
    nodes, chain = tree.nodes, np.empty(tree.grid[0].count, np.int32)
    n = write_ancestors(nodes, i, chain)
    out = np.empty((n, 2))
    for k in range(n):
        out[n - 1 - k, 0], out[n - 1 - k, 1] = nodes[chain[k]].x, nodes[chain[k]].y
    return out
