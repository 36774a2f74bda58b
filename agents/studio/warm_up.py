"""Compile the kernels of a drive while the page is open already, and report the progress.

`compile_in_process` is the process that compiles; it prints a line for each kernel. It shares the
work with helper processes of its own (`compiled.second_process`).
"""

import os
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any, Final

EXPECTED: Final = 90.0  # s that compiling takes on two cores
FIRST_DONE: Final = "the first drive may begin"  # a line that is no kernel's name


def first_drive() -> None:
    """Load or compile all that the first drive needs: a scene without people, and its assistant.

    While this process compiles what draws and assesses the scene, two others compile what moves a
    chair and what moves people, which a chair waits for. Three share two cores more evenly than
    two.
    """
    from agents.studio.catalogue import FIRST
    from wheelchair_gym.compiled.second_process import compile_beside
    from wheelchair_gym.sim.step import step_chair

    for work in (_drive_nowhere, _move_people):
        compile_beside(step_chair, work)
    _drive_in(FIRST)


def _drive_nowhere() -> None:
    import numpy as np

    from wheelchair_gym.sim.chair import SimulatedChair
    from wheelchair_gym.types import Episode

    nowhere: Any = None
    chair = SimulatedChair()
    chair.reset(Episode(nowhere, np.zeros(3), np.zeros(3)), 0)
    chair.drive(np.zeros(2))


def _move_people() -> None:
    from wheelchair_gym.compiled.kernel import compile_part
    from wheelchair_gym.sensors.settings import SensorSettings
    from wheelchair_gym.sim.chairs import SimulatedChairs
    from wheelchair_gym.sim.settings import ChairSettings, PhysicsSettings
    from wheelchair_gym.sim.step import decide_actors

    chairs = SimulatedChairs(ChairSettings(), SensorSettings(), PhysicsSettings(), 0.05)
    row = chairs.states[0], chairs.parameters[0], chairs.world_rows[0]
    compile_part(decide_actors, *row, (0.0, 0.0, 0.0, 0.0, 0.0))


def _drive_in(scene: str) -> None:
    import numpy as np

    from agents.people import make_assistant
    from agents.people.assistant import AssistMission
    from agents.studio.catalogue import FIRST_ASSISTANT
    from wheelchair_gym.envs import NavigationEnv
    from wheelchair_gym.types import Stick

    stick = Stick(0.1, 0.1, False)
    env = NavigationEnv(scene, pose_source="modelled", shield=True, person=lambda: stick)
    env.reset(seed=0)
    assistant = make_assistant(FIRST_ASSISTANT)
    assistant.reset(AssistMission(env.settings.chair, env.settings.sensors, env.task.period))
    assistant.assist(stick, env.reading, env.task.map)
    env.task.take_stick(stick, np.zeros(3), np.zeros(2))  # a step needs the chair, which is late
    env.task.assess(env.reading, (0.0, 0.0))
    for _ in range(3):
        env.step(np.array([0.1, 0.1], np.float32))
    env.task.way_to_go(env.task.reading.pose)
    env.close()


def everything() -> None:
    """Load or compile what a person may choose: assistants, hands, people."""
    import numpy as np

    from agents.evaluation.evaluate import drive_on
    from agents.people import ASSISTANTS
    from agents.policies import make_policy
    from agents.studio.catalogue import FIRST
    from wheelchair_gym.envs import NavigationEnv
    from wheelchair_gym.people.drivers import make_driver
    from wheelchair_gym.people.drivers.live_person import LiveInput, LiveSight
    from wheelchair_gym.perception.tracker import Tracker
    from wheelchair_gym.types import Stick

    stick = Stick(0.5, 0.1, False)
    env = NavigationEnv("crowd", pose_source="modelled", shield=True, person=lambda: stick)
    observation, _ = env.reset(seed=0)
    chair, sensors, period = env.settings.chair, env.settings.sensors, env.task.period
    LiveInput(make_driver("essential_tremor"), chair, sensors, period).step(0.5, 0.0, 0.0)
    LiveSight(make_driver("hemineglect").perception, 0).unnoticed(0.0)
    Tracker(laser=sensors.laser)
    for name in ASSISTANTS:
        drive_on(env, make_policy({"name": "assisted", "assist": name}), observation, 2)
    env.close()
    env = NavigationEnv(FIRST, pose_source="modelled", driver="novice")  # for the page Compare
    env.reset(seed=0)
    env.step(np.zeros(2, np.float32))
    env.close()


class WarmUp:
    """The state of warming up, which other threads read.

    Attributes:
        ready: the first drive may begin.
    """

    def __init__(self) -> None:
        self.ready, self.error = threading.Event(), ""
        self._begun, self._kernels, self._kernel = time.monotonic(), 0, ""
        self._compiling = False
        self._child: subprocess.Popen[str] | None = None

    def start(self) -> None:
        """Begin in the background, in a process that ends with this one."""
        # Not `-m`: helpers could not import the functions of `__main__`.
        code = "from agents.studio.warm_up import compile_in_process; compile_in_process()"
        root = str(Path(__file__).resolve().parents[2])
        path = os.pathsep.join(filter(None, [root, os.environ.get("PYTHONPATH", "")]))
        self._child = subprocess.Popen(
            [sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
            stdin=subprocess.DEVNULL, text=True, env={**os.environ, "PYTHONPATH": path},
        )  # fmt: skip
        threading.Thread(target=self._run, daemon=True, name="warm-up").start()

    def state(self) -> dict[str, Any]:
        """Return the page's state: whether a drive may begin, kernels compiled so far, a share."""
        seconds = time.monotonic() - self._begun
        ready = self.ready.is_set()
        return {
            "ready": ready, "kernels": self._kernels, "kernel": self._kernel,
            "compiling": self._compiling and not ready, "seconds": round(seconds, 1),
            "share": 1.0 if ready else min(0.95, seconds / (EXPECTED if self._compiling else 5.0)),
            "error": self.error,
        }  # fmt: skip

    def close(self) -> None:
        """End what still compiles."""
        if self._child is not None:
            self._child.kill()
            self._child.wait()

    def _count(self, kernel: str) -> None:
        self._kernel = kernel
        if kernel:
            self._kernels += 1
            self._compiling = True

    def _run(self) -> None:
        try:
            from wheelchair_gym.compiled.second_process import progress
            from wheelchair_gym.sim.step import step_chair
            from wheelchair_gym.task.assessment import assess

            progress.listener = self._count
            kernels: tuple[Any, ...] = step_chair, assess
            if not all(kernel.is_compiled for kernel in kernels):
                self._compiling = True
                self._follow(FIRST_DONE)
            first_drive()
        except Exception as error:  # the page shows it; a person may still try
            self.error = f"{type(error).__name__}: {error}"
        self.ready.set()
        self._kernel = ""
        self._follow("")

    def _follow(self, last: str) -> None:
        """Count what the process compiles, until it prints a last line; if empty, until it ends."""
        assert self._child is not None
        assert self._child.stdout is not None
        for line in self._child.stdout:
            if line.strip() == last:
                break
            if line.strip() != FIRST_DONE:
                self._count(line.strip())
        if not last:
            self._child.stdout.close()
        self._kernel = ""


def compile_in_process() -> None:
    """Compile in a process of the studio, what the first drive needs first.

    It prints a line for each kernel, and FIRST_DONE between the first drive and the rest.
    """
    from wheelchair_gym.compiled.second_process import progress

    studio = os.getppid()

    def tell(kernel: str) -> None:
        if os.getppid() != studio:  # the studio is gone
            os._exit(0)
        if kernel:
            print(kernel, flush=True)

    progress.listener = tell
    first_drive()
    print(FIRST_DONE, flush=True)
    if hasattr(os, "nice"):
        os.nice(10)
    everything()
