"""Images of maps: the samples of each pixel as the file encodes them, and the level of white.

PGM and PPM files are decoded here, because a sample is a share of the `maxval` of their header.
OpenCV decodes the other formats. A rotation by EXIF is applied.
"""

from __future__ import annotations

import io
import math
import re
import warnings
from pathlib import Path
from typing import Any, Final, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.base.errors import InputError
from wheelchair_gym.base.files import LIMITS, check_cells, read_bytes

Samples = NDArray[Any]  # unsigned integers

_FORMATS = ("PNG", "PPM", "BMP", "JPEG", "TIFF")
_GAP: Final = rb"(?:\s|#[^\r\n]*[\r\n])+"
_COMMENT: Final = re.compile(rb"#[^\r\n]*")
# Magic number, columns, rows and maxval; then one blank, or a comment's line.
_HEADER: Final = re.compile(rb"P([2356])" + 3 * (_GAP + rb"(\d+)") + rb"(?:\s|#[^\r\n]*[\r\n])")
_EXIF_ORIENTATION: Final = 0x0112


class Picture(NamedTuple):
    """The pixels of an image, top row first."""

    levels: Samples  # (rows, cols): the grey sample, or the sum of red, green and blue
    white: int  # the level of white; black is 0
    alpha: Samples | None = None  # (rows, cols); None where all pixels are opaque
    opaque: int = 255  # the largest alpha

    @property
    def whiteness(self) -> NDArray[np.float64]:
        """The share of white of each level (white + 1,)."""
        return np.arange(self.white + 1) / self.white


def read_picture(path: Path) -> Picture:
    """Read an image file.

    Raises:
        InputError: the image cannot be read, or is too large.
    """
    from PIL import Image  # only here, where the header alone is read

    content = read_bytes(path, "image")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of its own, looser limit
            header = Image.open(io.BytesIO(content), formats=_FORMATS)
    except Exception:  # whatever Pillow makes of damaged bytes
        raise _undecodable(path) from None
    columns, rows = header.size
    check_cells(rows, columns, str(path))
    # As OpenCV decodes it: 16 bits where the format has them, and every channel.
    size = rows * columns * max(1, len(header.getbands())) * (1 if "8" in header.mode else 2)
    if size > LIMITS["decoded"].maximum:
        raise InputError(
            f"{path}: {size:,} bytes of pixels; expected at most {LIMITS['decoded'].maximum:,}"
        )
    if header.format == "PPM" and header.mode != "1":
        return _netpbm(content, path)
    image = _decoded(content, path)
    if header.format == "JPEG" or b"eXIf" in content:  # OpenCV turns TIFF itself
        try:
            image = _turned(image, header.getexif().get(_EXIF_ORIENTATION, 1))
        except Exception:
            raise _undecodable(path) from None
    transparent = "transparency" in header.info or "A" in header.getbands()
    if transparent and (image.ndim == 2 or image.shape[2] != 4):
        raise InputError(f"{path}: its transparency cannot be decoded; expected a PNG with alpha")
    maximum = int(np.iinfo(image.dtype).max)
    if image.ndim == 2:
        return Picture(image, maximum)
    levels = image[..., :3].sum(axis=-1, dtype=np.uint32)
    return Picture(levels, 3 * maximum, image[..., 3] if image.shape[2] == 4 else None, maximum)


def _undecodable(path: Path) -> InputError:
    return InputError(f"{path}: not an image that can be decoded; expected PGM or PNG")


def _decoded(content: bytes, path: Path) -> Samples:
    """Decode an image (rows, cols) or (rows, cols, 3 or 4) of 8 or 16 bits with OpenCV."""
    level = cv2.utils.logging.getLogLevel()
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)  # the error below says it
    try:
        image = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error:
        image = None
    finally:
        cv2.utils.logging.setLogLevel(level)
    if image is None or image.size == 0:
        raise _undecodable(path)
    if image.dtype not in (np.uint8, np.uint16):
        raise InputError(f"{path}: pixels are {image.dtype}; expected 8 or 16 bits each")
    return image


def _turned(image: Samples, orientation: int) -> Samples:
    """Apply an orientation of EXIF, 1 to 8, to an image; other values count as 1."""
    if orientation in (5, 6, 7, 8):
        image = np.swapaxes(image, 0, 1)
    if orientation in (3, 4, 7, 8):
        image = image[::-1]
    if orientation in (2, 3, 6, 7):
        image = image[:, ::-1]
    return image


def _netpbm(content: bytes, path: Path) -> Picture:
    """Decode a PGM or PPM, as text (P2, P3) or binary (P5, P6)."""
    found = _HEADER.match(content)
    if found is None:
        raise _undecodable(path)
    kind, columns, rows, white = map(int, found.groups())
    shape, body = (rows, columns, 3 if kind in (3, 6) else 1), content[found.end() :]
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # older numpy warns where it finds no number
            samples: Samples = (
                np.fromstring(_COMMENT.sub(b" ", body), np.int64, sep=" ")[: math.prod(shape)]
                if kind < 5
                else np.frombuffer(body, ">u2" if white > 255 else "u1", math.prod(shape))
            ).reshape(shape)
    except (ValueError, DeprecationWarning):  # too few samples, or no numbers
        raise _undecodable(path) from None
    low, high = samples.min(), samples.max()
    if not 0 <= low <= high <= white:
        worst = low if low < 0 else high
        raise InputError(f"{path}: a sample is {worst}; expected 0 to {white}, its maxval")
    return Picture(samples.sum(axis=-1, dtype=np.uint32), shape[2] * white)
