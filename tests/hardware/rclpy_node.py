"""A real node of ROS 2: drives by TwistStamped, counts what it receives, and prints JSON.

    python rclpy_node.py SECONDS

It knows nothing of this project and runs where rclpy is installed. The first line that it prints
says that the chair moves; the last one is what it has counted.
"""

import json
import sys
import time

import rclpy
from geometry_msgs.msg import TwistStamped
from nav_msgs.msg import OccupancyGrid, Odometry
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy, qos_profile_sensor_data
from sensor_msgs.msg import BatteryState, LaserScan, Range

LATCHED = QoSProfile(
    depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL, reliability=ReliabilityPolicy.RELIABLE
)
DEEP = QoSProfile(depth=50, reliability=ReliabilityPolicy.RELIABLE)  # what the robot offers
SPEED = 0.5  # rad/s


def stamp_of(message):
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec


class Counter(Node):
    def __init__(self):
        simulated = Parameter("use_sim_time", Parameter.Type.BOOL, True)
        super().__init__("counter", parameter_overrides=[simulated])
        self.counts, self.delays, self.stamps, self.short = {}, [], [], []
        self.ticks, self.moving, self.cells, self.beams = 0, False, 0, 0
        for topic, kind, qos in (
            ("/scan", LaserScan, DEEP), ("/odom", Odometry, 10),
            ("/map", OccupancyGrid, LATCHED), ("/ultrasonic_0", Range, qos_profile_sensor_data),
            ("/battery_state", BatteryState, 10),
        ):  # fmt: skip
            self.create_subscription(kind, topic, self.receive(topic), qos)
        self.create_subscription(LaserScan, "/scan", self.hear_short, qos_profile_sensor_data)
        self.publisher = self.create_publisher(TwistStamped, "/cmd_vel", 10)
        self.create_timer(0.05, self.drive)  # of the simulated time

    def hear_short(self, message):
        self.short.append(stamp_of(message))

    def receive(self, topic):
        def take(message, info):
            self.counts[topic] = self.counts.get(topic, 0) + 1
            if topic == "/scan":
                self.stamps.append(stamp_of(message))
                self.delays.append(info["received_timestamp"] - info["source_timestamp"])
                self.beams = len(message.ranges)
            elif topic == "/map":
                self.cells = len(message.data)
            elif topic == "/odom" and not self.moving:
                self.moving = abs(message.twist.twist.angular.z) > 0.2 * SPEED
                if self.moving:
                    print("moving", flush=True)

        return take

    def drive(self):
        self.ticks += 1
        message = TwistStamped()
        message.header.stamp = self.get_clock().now().to_msg()
        message.twist.angular.z = SPEED
        self.publisher.publish(message)


def main(seconds):
    rclpy.init()
    node = Counter()
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        rclpy.spin_once(node, timeout_sec=0.1)
    delays = sorted(node.delays)
    found = {
        "counts": node.counts, "stamps": node.stamps, "short": node.short,
        "ticks": node.ticks, "cells": node.cells, "beams": node.beams,
        "clock": node.get_clock().now().nanoseconds,
        "delay_ms": [1e-6 * delays[int(q * (len(delays) - 1))] for q in (0.5, 0.95, 0.99, 1.0)],
        "nodes": node.get_node_names(), "topics": dict(node.get_topic_names_and_types()),
    }  # fmt: skip
    print(json.dumps(found), flush=True)


if __name__ == "__main__":
    main(float(sys.argv[1]))
