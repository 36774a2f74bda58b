"""A controller that knows ROS's messages, and nothing of this project, drives the simulated chair.

Beside `wheelchair robot --episodes 5`: A*, pure pursuit, and slowly back where it cannot turn.
"""

import cmath
import heapq
import json
import sys

import numpy as np
from scipy.ndimage import distance_transform_edt
from websockets.sync.client import connect


def plan(grid, start, goal):
    """Points x + y * 1j of a path on a nav_msgs/OccupancyGrid; near walls, cells cost more."""
    info, came, corner = grid["info"], {}, grid["info"]["origin"]["position"]
    size, corner = info["resolution"], complex(corner["x"], corner["y"])
    free = np.pad(np.array(grid["data"]).reshape(info["height"], info["width"]) == 0, 1)
    wall = size * distance_transform_edt(free)
    price = np.where(wall < 0.33, 100.0, 1.0) + 8.0 * np.clip(0.8 - wall, 0.0, None)
    first, last = np.floor((np.array([start, goal]) - corner).view(float) / size + 1).view(complex)
    cost, heap = {first: 0.0}, [(0.0, first.real, first.imag)]
    while heap and (at := complex(*heapq.heappop(heap)[1:])) != last:
        for step in (1, -1, 1j, -1j, 1 + 1j, 1 - 1j, -1 + 1j, -1 - 1j):
            to, cell = at + step, (int((at + step).imag), int((at + step).real))
            new = cost[at] + abs(step) * price[cell]
            if free[cell] and new < cost.get(to, np.inf):
                cost[to], came[to] = new, at
                heapq.heappush(heap, (new + abs(to - last), to.real, to.imag))
    path = [last]
    while path[-1] in came:
        path.append(came[path[-1]])
    return [(cell - 0.5 - 0.5j) * size + corner for cell in path[::-1]]


with connect((sys.argv[1:] or ["ws://127.0.0.1:9090"])[0], max_size=None) as link:
    for topic in ("/map", "/goal_pose", "/tf"):
        link.send(json.dumps({"op": "subscribe", "topic": topic}))
    link.send(json.dumps({"op": "advertise", "topic": "/cmd_vel", "type": "geometry_msgs/Twist"}))
    newest, path, stood, still = {}, [], 0j, 0
    for topic, msg in ((m.get("topic"), m.get("msg")) for m in map(json.loads, link)):
        newest[topic], path = msg, path if topic == "/tf" else []
        if topic == "/tf" and {"/map", "/goal_pose"} <= newest.keys():
            at, ahead = 0j, 1 + 0j
            for edge in (one["transform"] for one in newest["/tf"]["transforms"]):  # from the map
                at += ahead * complex(edge["translation"]["x"], edge["translation"]["y"])
                ahead *= complex(edge["rotation"]["w"], edge["rotation"]["z"]) ** 2
            goal = newest["/goal_pose"]["pose"]["position"]
            path = path or plan(newest["/map"], at, complex(goal["x"], goal["y"]))
            path = path[min(range(len(path)), key=lambda k: abs(path[k] - at)) :]
            aim = next((point for point in path if abs(point - at) > 0.5), path[-1])
            off = cmath.phase((aim - at) / ahead) if aim != at else 0.0
            v, w = 0.5 * max(0.0, 1.0 - abs(off)), max(-0.8, min(0.8, 1.5 * off))
            still = still + 1 if still < 0 or abs(at + ahead - stood) < 0.1 else 0
            stood, still = stood if still else at + ahead, still if still < 100 else -300
            v, w, path = (v, w, path) if still >= 0 else (-0.05, 0.0, path if still < -1 else [])
            twist = {"linear": {"x": v}, "angular": {"z": w}}
            link.send(json.dumps({"op": "publish", "topic": "/cmd_vel", "msg": twist}))
