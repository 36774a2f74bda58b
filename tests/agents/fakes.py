"""A chair on paper: it drives exactly as its ramps say, and sees exactly."""

import numpy as np

from agents.policies import GymPolicy, make_policy
from tests.sensors.test_laser import brute_force
from wheelchair_gym.geometry.kinematics import Limits, approach_twist, arc_step
from wheelchair_gym.geometry.planar import to_world
from wheelchair_gym.maps import FREE, OCCUPIED, OccupancyGrid
from wheelchair_gym.sensors.settings import LaserSettings, SensorSettings
from wheelchair_gym.sim.settings import ChairSettings
from wheelchair_gym.types import Mission, Reading

BEAMS = 181


def corridor(length=8.0, width=1.6):
    """A map of a straight corridor along x, its middle at y = 0."""
    rows, cols = round((width + 0.4) / 0.05), round(length / 0.05)
    cells = np.full((rows, cols), FREE, np.int8)
    cells[:4], cells[-4:] = OCCUPIED, OCCUPIED
    return OccupancyGrid(cells, 0.05, (0.0, -0.5 * rows * 0.05, 0.0))


def scan(pose, walls, laser):
    x, y = to_world((laser.x, 0.0), pose)
    angles = np.linspace(-0.5, 0.5, BEAMS) * laser.fov
    ranges, _ = brute_force(x, y, pose[2], angles, walls, (), np.inf)
    return np.where(ranges < laser.reach, ranges, np.inf).astype(np.float32)


def infos_of(env, policy):
    """Drive from where an environment stands to the end of the episode; yield each step's info."""
    driver = GymPolicy(make_policy(policy), env)
    driver.reset()
    observation, over = env.unwrapped.task.observation, False
    while not over:
        observation, _, ended, late, info = env.step(driver.act(observation))
        over = ended or late
        yield info


def reading(scan, twist=(0.0, 0.0), stamp=0.0, pose=(0.0, 0.0, 0.0), ultrasonic=np.inf, age=0.0):
    """Return a reading of a chair; all ultrasonics hear the same, and are as old."""
    ranges, ages = (np.full(8, value, np.float32) for value in (ultrasonic, age))
    scan, pose = np.asarray(scan, np.float32), np.array(pose, float)
    return Reading(pose, np.array(twist), scan, ranges, ages, False, 24.0, stamp)


class PaperWorld:
    """A mission, and readings that follow the actions of a policy; `seen` is the latest."""

    def __init__(self, grid, start, goal, period=0.1, **limits):
        self.sensors = SensorSettings(laser=LaserSettings(beams=BEAMS))
        self.walls = grid.walls()
        self.pose, self.state, self.time = np.array(start, float), np.zeros(4), 0.0
        self.seen = self.reading()
        chair = ChairSettings(limits=Limits(**limits))
        self.mission = Mission(
            map=grid, reading=self.seen, goal=np.array(goal, float), tolerance=0.3,
            time_limit=60.0, period=period, chair=chair, sensors=self.sensors,
            shield=None, is_shielded=False, key=7,
        )  # fmt: skip

    def reading(self):
        seen = scan(self.pose, self.walls, self.sensors.laser)
        return reading(seen, self.state[[0, 2]], self.time, self.pose)

    def drive(self, action):
        v, w = self.mission.limits.twist(action)
        limits, dt = self.mission.limits.record, self.mission.period
        self.state[:] = approach_twist(*self.state, v, w, limits, dt)
        self.pose = np.array(arc_step(*self.pose, self.state[0], self.state[2], dt))
        self.time += dt
        self.seen = self.reading()

    def step(self, policy):
        command = policy.act(self.seen)
        self.drive(command.as_action(self.mission.limits))
        return command

    def run(self, policy, seconds):
        """Poses (n, 3) and actions (n, 2) until the goal or for so long."""
        policy.reset(self.mission)
        poses, actions = [], []
        while self.time < seconds and np.hypot(*(self.pose[:2] - self.mission.goal[:2])) > 0.2:
            command = self.step(policy)
            poses.append(self.pose)
            actions.append(command.as_action(self.mission.limits))
        return np.array(poses), np.array(actions)
