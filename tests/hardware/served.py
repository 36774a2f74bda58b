"""`wheelchair` in a process of its own, for tests."""

import os
import re
import signal
import subprocess
import sys
import threading
from contextlib import contextmanager

from tests.conftest import PATIENCE, ROOT, until


@contextmanager
def signals_kept():
    """Restore the handlers of signals that a command in this process sets."""
    before = {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGHUP)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def hear_interrupts():
    """Make started programs receive SIGINT, which background jobs of a shell ignore."""
    if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


@contextmanager
def frozen(code, *words):
    """A program of Python that has said that it heard something, and then stands still."""
    command = [sys.executable, "-c", code, *words]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as program:
        try:
            assert program.stdout.readline() == "heard\n"
            program.send_signal(signal.SIGSTOP)
            yield
        finally:
            program.kill()


class Program:
    """`wheelchair` with arguments in a process of its own, and what it says."""

    def __init__(self, *arguments, cwd=None, **more):
        command = [sys.executable, "-m", "wheelchair_gym", *arguments]
        environ = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), *sys.path]), **more}
        hear_interrupts()
        self.process = subprocess.Popen(
            command, env=environ, cwd=cwd, text=True, stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
        )  # fmt: skip
        self.said, self.errors = [], []
        pairs = (self.process.stdout, self.said), (self.process.stderr, self.errors)
        self._threads = [
            threading.Thread(target=self._read, args=one, daemon=True) for one in pairs
        ]
        for thread in self._threads:
            thread.start()

    def _read(self, stream, lines):
        for line in stream:
            lines.append(line)

    def close(self):
        """End it as Ctrl-C does; its exit code."""
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGINT)
        code = self.process.wait(PATIENCE)
        for thread in self._threads:
            thread.join()
        return code


class Served(Program):
    """`wheelchair robot`, from when it is ready until it is closed."""

    def __init__(self, *arguments, **more):
        super().__init__("robot", "--port", "0", *arguments, **more)
        assert until(lambda: any("goal" in line for line in self.said)), self.errors
        self.url = re.search(r"(wss?|dds)://\S+", "".join(self.said))[0]
