"""The firmware on its emulated boards: sizes, waits of interrupts, jitter; stops are in `stops`.

`python -m tests.benchmarks.firmware`: JSON on stdout.
All times are of the emulated world, so they are the same on any machine; `times_real_time` alone
depends on this one.
"""

import json
import subprocess
import time

import numpy as np

from tests.hardware.bench import ibus
from tests.hardware.pilot import Pilot
from wheelchair_gym.hardware.boards.protocol import Odometry, Receiver
from wheelchair_gym.hardware.twin.board import FREQUENCY, EmulatedBoard, build_target
from wheelchair_gym.hardware.twin.lockstep import IBUS_BAUD

# Interrupt vectors of the ATmega2560, and the pin that changes with each run of the control.
VECTORS = {"encoders": 9, "tick": 13, "host": 25, "joystick": 36}
BEAT = ("L", 4)
TOP = 0.8  # m/s


def sizes():
    """Flash and static RAM of both boards [bytes]."""
    result = {}
    for board in ("drive", "range"):
        text = subprocess.run(
            ["avr-size", build_target(f"{board}.elf")], capture_output=True, text=True, check=True
        ).stdout
        code, data, zeroed = map(int, text.splitlines()[1].split()[:3])
        result[board] = {"flash": code + data, "ram": data + zeroed}
    return result


def untouched(board, first, last):
    """RAM between the static data and the deepest stack so far [bytes]: still zero."""
    address = first
    while address <= last and board.read_memory(address) == 0:
        address += 1
    return address - first


def loaded(seconds=20.0):
    """Waits and jitter while everything happens at once: top speed, turning, host and joystick."""
    pilot = Pilot()
    drive = pilot.twin.drive
    pilot.start(0.5, 0.0, 1.0)
    for vector in VECTORS.values():
        drive.call("watch", vector)
    drive.call("note", BEAT[0].encode(), BEAT[1])
    rng = np.random.default_rng(1)
    beats, began = [], time.perf_counter()
    for k in range(round(seconds / 0.1)):
        pilot.target = (TOP, float(rng.uniform(-1, 1))) if k % 10 else (0.0, 0.0)
        drive.write(b"".join(ibus() for _ in range(13)), 1)
        pilot.run(0.1)
        beats.append(drive.pin_changes().astype(np.int64))
    took = time.perf_counter() - began
    us = 1e6 / FREQUENCY
    each = np.diff(np.concatenate(beats)) * us
    waits = {name: round(drive.call("waited", v, [0]) * us, 2) for name, v in VECTORS.items()}
    ram = {name: size["ram"] for name, size in sizes().items()}
    free = {
        name: untouched(board, start + ram[name], end)
        for name, board, start, end in (
            ("drive", drive, 0x200, 0x21FF),
            ("range", pilot.twin.range, 0x100, 0x8FF),
        )
    }
    return {
        "ram_never_touched_bytes": free,
        "worst_wait_us": waits,
        "control_us": {
            "mean": round(float(each.mean()), 2),
            "least": round(float(each.min()), 1),
            "most": round(float(each.max()), 1),
            "deviation": round(float(each.std()), 1),
        },
        "refused_or_lost": [pilot.bad, pilot.now.bad, pilot.now.lost, drive.call("overruns")],
        "times_real_time": round(seconds / took, 1),
    }


def encoder_limit():
    """The most edges a second of both encoders together at which not a count is lost."""
    best = 0
    for rate in range(20_000, 200_001, 10_000):
        board = EmulatedBoard("atmega2560", "drive.elf", (500_000, IBUS_BAUD))
        for bit in range(4):
            board.set_pin("B", bit, False)
        board.run(FREQUENCY // 50)
        n = rate // 2 // 5  # counts of each wheel in 0.2 s
        until = FREQUENCY // 50 + FREQUENCY // 5
        board.rotate_encoder("B", 0, 0.0, n + 0.25, until)
        board.rotate_encoder("B", 2, 0.0, n + 0.75, until)
        board.run(until + FREQUENCY // 20)
        heard = [f.message for f in Receiver().feed(board.read())]
        last = [m for m in heard if isinstance(m, Odometry)][-1]
        board.close()
        if (last.left, last.right) != (n, n):
            break
        best = rate
    return best


def main():
    report = {"sizes_bytes": sizes(), **loaded(), "encoder_edges_per_s": encoder_limit()}
    print(json.dumps(report, indent=1))


if __name__ == "__main__":
    main()
