"""What sensors see of actors: segments and discs behind the walls and discs that stay."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.compiled.address import doubles_at, table_at
from wheelchair_gym.compiled.kernel import borrowing_kernel
from wheelchair_gym.physics.actors.bodies import actor_states_at, actors_at, is_box
from wheelchair_gym.physics.actors.records import DOOR

Array = NDArray[np.float64]


@borrowing_kernel
def write_actor_shapes(world: Any) -> None:
    """Write what sensors see of the actors behind the walls and discs that stay."""
    n = world.n_actors
    rows, actor_states = actors_at(world.actors, n), actor_states_at(world.actor_states, n)
    walls = table_at(world.walls, world.n_walls, 4)
    discs = table_at(world.discs, world.n_discs, 3)
    for k in range(n):
        row, state = rows[k], actor_states[k]
        x, y = state.pose[0], state.pose[1]
        at = state.slot
        if not is_box(row):
            discs[at, 0], discs[at, 1], discs[at, 2] = x, y, row.size[0]
            continue
        c, s = math.cos(state.pose[2]), math.sin(state.pose[2])
        front, b = row.size[0] if row.kind == DOOR else 0.5 * row.size[0], 0.5 * row.size[1]
        rear = front - row.size[0]
        px, py = x + c * rear - s * b, y + s * rear + c * b
        for i in range(4):
            ex, ey = front if i == 1 or i == 2 else rear, b if i > 1 else -b
            qx, qy = x + c * ex - s * ey, y + s * ex + c * ey
            walls[at + i, 0], walls[at + i, 1] = px, py
            walls[at + i, 2], walls[at + i, 3] = qx, qy
            px, py = qx, qy


@borrowing_kernel
def _copy(source: Array, first: int, last: int, out: Array, at: int) -> int:
    """Copy rows first to last of a table into a flat array from `at` on; where that ends."""
    for k in range(first, last):
        for i in range(source.shape[1]):
            out[at] = source[k, i]
            at += 1
    return at


@borrowing_kernel
def save_actor_shapes(world: Any, which: int) -> None:
    """Keep what a ranger sees of the actors at the instant when it fires."""
    write_actor_shapes(world)
    walls = table_at(world.walls, world.n_walls, 4)
    discs = table_at(world.discs, world.n_discs, 3)
    shot = doubles_at(world.snapshots, world.snapshot_size * (which + 1))[
        world.snapshot_size * which :
    ]
    at = _copy(walls, world.n_fixed_walls, world.n_walls, shot, 0)
    _copy(discs, world.n_fixed_discs, world.n_discs, shot, at)


@borrowing_kernel
def restore_actor_shapes(world: Any, which: int) -> None:
    """Show the actors as a ranger saw them when it fired."""
    walls = table_at(world.walls, world.n_walls, 4)
    discs = table_at(world.discs, world.n_discs, 3)
    shot = doubles_at(world.snapshots, world.snapshot_size * (which + 1))[
        world.snapshot_size * which :
    ]
    at = 0
    for k in range(world.n_fixed_walls, world.n_walls):
        for i in range(4):
            walls[k, i] = shot[at]
            at += 1
    for k in range(world.n_fixed_discs, world.n_discs):
        for i in range(3):
            discs[k, i] = shot[at]
            at += 1
