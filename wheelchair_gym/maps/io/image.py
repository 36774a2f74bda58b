"""Images of maps: the samples of each pixel as the file encodes them, and the level of white.

Netpbm files (PBM, PGM, PPM, text and binary) are decoded here, because a sample is a share of the
`maxval` of their header. OpenCV decodes the other formats. A rotation by EXIF is applied.
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

from wheelchair_gym.errors import InputError
from wheelchair_gym.files import LIMITS, check_cells, read_bytes

Samples = NDArray[Any]  # unsigned integers

_FORMATS = ("PNG", "PPM", "BMP", "JPEG", "TIFF")
_GAP: Final = rb"(?:\s|#[^\r\n]*[\r\n])+"
_COMMENT: Final = re.compile(rb"#[^\r\n]*")
# Magic number, columns, rows; for all but bitmaps also maxval; then one blank, or a comment's line.
_BITMAP: Final = re.compile(rb"P([14])" + 2 * (_GAP + rb"(\d+)") + rb"(?:\s|#[^\r\n]*[\r\n])")
_PIXMAP: Final = re.compile(rb"P([2356])" + 3 * (_GAP + rb"(\d+)") + rb"(?:\s|#[^\r\n]*[\r\n])")
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
            exif = {} if header.format in ("PPM", "TIFF") else header.getexif()
            turn = exif.get(_EXIF_ORIENTATION, 1)  # OpenCV turns TIFF itself
    except Exception:  # whatever Pillow makes of damaged bytes
        raise _undecodable(path) from None
    columns, rows = header.size
    check_cells(rows, columns, str(path))
    # As OpenCV decodes it: 16 bits where the format has them, and every channel.
    size = rows * columns * max(1, len(header.getbands())) * (1 if "8" in header.mode else 2)
    if size > LIMITS["decoded"].most:
        raise InputError(
            f"{path}: {size:,} bytes of pixels; expected at most {LIMITS['decoded'].most:,}"
        )
    if header.format == "PPM":
        return _netpbm(content, path)
    image = _turned(_decoded(content, path), turn)
    transparent = "transparency" in header.info or "A" in header.getbands()
    if transparent and (image.ndim == 2 or image.shape[2] != 4):
        raise InputError(f"{path}: its transparency cannot be decoded; expected a PNG with alpha")
    most = int(np.iinfo(image.dtype).max)
    if image.ndim == 2:
        return Picture(image, most)
    levels = image[..., :3].sum(axis=-1, dtype=np.uint32)
    return Picture(levels, 3 * most, image[..., 3] if image.shape[2] == 4 else None, most)


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
    """Decode a PBM, PGM or PPM, as text (P1 to P3) or binary (P4 to P6)."""
    found = _BITMAP.match(content) or _PIXMAP.match(content)
    if found is None:
        raise _undecodable(path)
    kind, columns, rows, white = map(int, (*found.groups(), b"1")[:4])
    if not 1 <= white <= 65_535:
        raise InputError(f"{path}: maxval is {white}; expected 1 to 65535")
    shape = (rows, columns, 3 if kind in (3, 6) else 1)
    try:
        samples = _netpbm_samples(kind, content[found.end() :], shape, white)
    except (ValueError, DeprecationWarning):  # too few samples, or no numbers
        raise _undecodable(path) from None
    if not 0 <= samples.min() <= samples.max() <= white:
        worst = samples.min() if samples.min() < 0 else samples.max()
        raise InputError(f"{path}: a sample is {worst}; expected 0 to {white}, its maxval")
    if shape[2] == 1:
        return Picture(samples[..., 0].astype(np.uint16), white)
    return Picture(samples.sum(axis=-1, dtype=np.uint32), 3 * white)


def _netpbm_samples(kind: int, body: bytes, shape: tuple[int, int, int], white: int) -> Samples:
    """Decode the samples (rows, columns, channels) of a Netpbm file; in bitmaps 1 is white.

    Raises:
        ValueError: there are too few samples, or some are no numbers.
    """
    rows, columns, _ = shape
    count = math.prod(shape)
    if kind == 4:
        packed = np.frombuffer(body, np.uint8, rows * -(-columns // 8)).reshape(rows, -1)
        return np.unpackbits(packed, axis=1, count=columns).reshape(shape) ^ 1
    if kind > 4:
        return np.frombuffer(body, ">u2" if white > 255 else "u1", count).reshape(shape)
    text = _COMMENT.sub(b" ", body)
    if kind == 1:  # bits may stand without blanks between them
        bits = np.frombuffer(b"".join(text.split()), np.uint8, count).reshape(shape)
        if not np.isin(bits, (ord("0"), ord("1"))).all():
            raise ValueError("a bit is neither 0 nor 1")
        return ord("1") - bits
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # older numpy warns where it finds no number
        return np.fromstring(text, np.int64, sep=" ")[:count].reshape(shape)
