"""Serial ports: opened exclusively, with an explanation and advice where one cannot be opened."""

import contextlib
import errno
import os
import stat
from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol

from wheelchair_gym.base.errors import load_extra
from wheelchair_gym.hardware.boards.protocol import BAUD

_BY_ID = "/dev/serial/by-id"  # names that do not depend on the order of plugging in
_TERMINALS = range(136, 144)  # major numbers of Linux's pseudo-terminals
_BUSY = (errno.EBUSY, errno.EAGAIN, errno.EWOULDBLOCK)
_REFUSED = (errno.EACCES, errno.EPERM)
_GONE = (errno.ENOENT, errno.ENODEV, errno.ENXIO)
_LONGEST = 80  # characters of a program's command line
_MODEM_MANAGER = (
    "ModemManager runs, which tries each new serial port for half a minute: wait, or "
    "`sudo systemctl disable --now ModemManager`"
)


class Port(Protocol):
    """A serial port as a link needs it, such as pyserial's."""

    def read_all(self) -> bytes:
        """All bytes that have come, without waiting."""

    def write(self, data: bytes) -> int:
        """Send bytes; returns how many the port took."""

    def close(self) -> None:
        """Close the port."""


class _SerialPort:
    """A port of pyserial, with a way of writing that returns how many bytes were taken."""

    def __init__(
        self, port: Any, write: Callable[[bytes], int], full: tuple[type[Exception], ...]
    ) -> None:
        self.read_all, self.close = port.read_all, port.close
        self._write, self._full = write, full

    def write(self, data: bytes) -> int:
        try:
            return self._write(data)
        except self._full:
            return 0


def open_port(url: str) -> Port:
    """Open a device, or any URL that pyserial knows; neither reading nor writing a device waits.

    A device is locked against other programs. The first opening after it was plugged in resets an
    Arduino; later ones do not, since DTR keeps its level.

    Raises:
        OSError: it cannot be opened; the text says why, and what to do.
        InputError: pyserial is not installed.
    """
    serial = load_extra("serial")
    port: Any = serial.serial_for_url(
        url, baudrate=BAUD, timeout=0, write_timeout=0.1, exclusive=True, do_not_open=True
    )
    try:
        port.open()
    except OSError as error:
        raise explain(url, error) from None
    write: Callable[[bytes], int] = port.write
    number: int | None = getattr(port, "fd", None)
    if number is not None and is_device(url):
        _claim(number, url)
        # pyserial 3.5 tries for ever to write to a full port with a timeout of 0. With any other it
        # says of sent bytes, too, that time is up, when the computer was busy meanwhile.
        write = lambda data: os.write(port.fileno(), data)  # noqa: E731
    return _SerialPort(port, write, (BlockingIOError, serial.SerialTimeoutException))


def is_device(url: str) -> bool:
    """Whether a URL names a device of this computer."""
    return "://" not in url


def may_reset(url: str) -> bool:
    """Whether opening a URL may reset a board: a serial device, but no pseudo-terminal."""
    try:
        found = os.stat(url)
    except (OSError, ValueError):
        return False
    return stat.S_ISCHR(found.st_mode) and os.major(found.st_rdev) not in _TERMINALS


def explain(url: str, error: OSError) -> OSError:
    """The error of a port as a line that names the port and says what to do."""
    if not is_device(url):
        return error
    number = error.errno
    if number in _BUSY:
        who = holders(url)
        text = f"{url} is in use by {who or 'another program'}; end it first"
        if not who or "ModemManager" in who:
            text += f" ({_MODEM_MANAGER})" if is_running("ModemManager") else ""
    elif number in _REFUSED:
        text = (
            f"{url}: you have no right to open it: sudo usermod -aG {_group(url)} $USER, then log "
            "out and in again"
        )
    elif number in _GONE:
        text = f"{url}: there is no such device: plug the board in, or name its port; {_ports()}"
    elif "returned no data" in str(error):
        text = f"{url}: it was unplugged, or has no power"
    else:
        text = f"{error}" if url in str(error) else f"{url}: {error}"
    return OSError(" ".join(text.split()))


def silent_advice() -> str:
    """Advice for a port that is open and whose board is silent."""
    advice = "its firmware (make firmware), its power; another board's port"
    return f"{advice}; {_MODEM_MANAGER}" if is_running("ModemManager") else advice


def holders(device: str) -> str:
    """The programs that hold a device, as far as /proc shows; empty: unknown."""
    real = os.path.realpath(device)
    numbers = _lockers(real) or _openers(real)
    if numbers == [os.getpid()]:
        return "this very program (does another line of the config name the same device?)"
    return " or ".join(_program(k) for k in numbers if k != os.getpid())


def is_running(program: str) -> bool:
    """Whether a program of that name runs, as far as /proc shows."""
    for file in Path("/proc").glob("[0-9]*/comm"):
        with contextlib.suppress(OSError):
            if file.read_text(errors="replace").strip() == program:
                return True
    return False


def _claim(number: int, url: str) -> None:
    """Lock a port, and keep its next opening from resetting the board."""
    with contextlib.suppress(ImportError, OSError):  # not every system has these calls
        import fcntl
        import termios

        settings = termios.tcgetattr(number)
        settings[2] &= ~termios.HUPCL
        termios.tcsetattr(number, termios.TCSANOW, settings)
        if may_reset(url):  # a pseudo-terminal would stay locked after this program is killed
            fcntl.ioctl(number, termios.TIOCEXCL)


def _lockers(real: str) -> list[int]:
    """Processes that have a lock on a file."""
    try:
        found, lines = os.stat(real), Path("/proc/locks").read_text().splitlines()
    except OSError:
        return []
    key = f"{os.major(found.st_dev):02x}:{os.minor(found.st_dev):02x}:{found.st_ino}"
    rows = [line.split() for line in lines]
    return [int(row[4]) for row in rows if len(row) > 5 and row[5] == key and int(row[4]) > 0]


def _openers(real: str) -> list[int]:
    """Processes that have a file open, of those that this user may inspect."""
    found = set()
    for link in Path("/proc").glob("[0-9]*/fd/*"):
        with contextlib.suppress(OSError):
            if os.readlink(link) == real:
                found.add(int(link.parts[2]))
    return sorted(found)


def _program(number: int) -> str:
    try:
        words = Path(f"/proc/{number}/cmdline").read_bytes().decode(errors="replace")
    except OSError:
        words = ""
    name = " ".join(words.replace("\0", " ").split())[:_LONGEST]
    return f"{name} (process {number})" if name else f"process {number}"


def _group(device: str) -> str:
    """The group whose members may open a device."""
    try:
        name = Path(device).group()
    except (KeyError, NotImplementedError, OSError):
        name = "root"
    return "dialout" if name == "root" else name  # Debian's; only root owns what is no port


def _ports() -> str:
    """The serial ports of this computer, by names that do not change."""
    names = sorted(path.name for path in Path(_BY_ID).glob("*"))
    if not names:
        return "no USB serial port is there"
    return f"there are, under {_BY_ID}: " + ", ".join(names)
