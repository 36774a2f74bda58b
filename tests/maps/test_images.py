"""The same picture in any encoding gives the same cells."""

import cv2
import numpy as np
import pytest
from PIL import Image

from tests.maps.test_files import describe
from wheelchair_gym.base.settings import InputError
from wheelchair_gym.maps import FREE, OCCUPIED, UNKNOWN, read_map
from wheelchair_gym.maps.io.floor_plan import read_floor_plan_image

STEPS = 5  # grey k of these is the share k / 5 of white, which each encoding below can hold exactly
THRESHOLDS = {"occupied_thresh": 0.6, "free_thresh": 0.2}
INVERSE = {
    2: "FLIP_LEFT_RIGHT", 3: "ROTATE_180", 4: "FLIP_TOP_BOTTOM", 5: "TRANSPOSE", 6: "ROTATE_90",
    7: "TRANSVERSE", 8: "ROTATE_270",
}  # fmt: skip


def netpbm(picture, kind, white):
    """Encode a picture of shares as P1 to P6 with this maxval, as the specification says."""
    rows, columns = picture.shape
    samples = picture * white // STEPS
    if kind in (3, 6):
        samples = np.repeat(samples[..., None], 3, axis=-1)
    head = f"P{kind}\n# made by a test\n{columns} {rows}\n"
    if kind in (1, 4):
        black = (samples == 0).astype(np.uint8)
        body = (
            "".join(map(str, black.ravel())).encode() if kind == 1 else np.packbits(black, axis=1)
        )
        return head.encode() + bytes(body)
    head += f"{white}\n"
    if kind in (2, 3):
        return (head + "  \n".join(map(str, samples.ravel().tolist())) + " # end\n").encode()
    return head.encode() + samples.astype(">u2" if white > 255 else "u1").tobytes()


def encodings(picture):
    """Yield the name of a file and a function that writes the picture to a path."""
    bilevel = set(np.unique(picture)) <= {0, STEPS}
    for white in (5, 10, 100, 255, 4095, 65535, *(1, 7) * bilevel):
        for kind in (2, 3, 5, 6, *(1, 4) * (bilevel and white == 1)):
            data = netpbm(picture, kind, white)
            yield f"p{kind}-{white}.pgm", lambda path, data=data: path.write_bytes(data)
    grey = (picture * 51).astype(np.uint8)
    deep = (picture * 13107).astype(np.uint16)
    opaque = np.full_like(deep, 65535)
    for name, image in {
        "grey.png": grey, "grey.bmp": grey, "grey.tif": grey, "deep.png": deep, "deep.tif": deep,
        "deep-rgb.png": np.dstack([deep] * 3), "deep-rgba.png": np.dstack([deep] * 3 + [opaque]),
    }.items():  # fmt: skip
        yield name, lambda path, image=image: cv2.imwrite(str(path), image)
    page = Image.fromarray(grey)
    for mode in ("RGB", "RGBA", "LA", "P", *["1"] * bilevel):
        yield f"{mode}.png", page.convert(mode).save
    for orientation, turn in INVERSE.items():
        exif = Image.Exif()
        exif[0x0112] = orientation
        stored = page.transpose(Image.Transpose[turn])
        yield f"{orientation}.png", lambda path, s=stored, e=exif: s.save(path, exif=e)
        if bilevel:
            block = stored.resize((8 * stored.width, 8 * stored.height), Image.Resampling.NEAREST)
            yield f"{orientation}.jpg", lambda path, s=block, e=exif: s.save(path, exif=e)


@pytest.mark.filterwarnings("ignore:.*of its pixels are grey")
@pytest.mark.parametrize("levels", [(0, STEPS), range(STEPS + 1)], ids=["bilevel", "greys"])
@pytest.mark.parametrize(
    ("negate", "mode"), [(0, "trinary"), (1, "trinary"), (0, "scale"), (0, "raw")]
)
def test_the_same_picture_gives_the_same_cells(tmp_path, levels, negate, mode):
    picture = np.random.default_rng(negate).choice(levels, (7, 11))
    p = picture if negate else STEPS - picture
    between = np.rint(100 * (p / STEPS - 0.2) / 0.4) if mode == "scale" else UNKNOWN
    expected = np.where(p >= 3, OCCUPIED, np.where(p <= 1, FREE, between))
    if mode == "raw":
        expected = np.where(51 * picture <= OCCUPIED, 51 * picture, UNKNOWN)
    inner = np.where(picture / STEPS < 192 / 255, OCCUPIED, FREE)
    for name, write in encodings(picture):
        write(tmp_path / name)
        file = describe(tmp_path, image=name, negate=negate, mode=mode, **THRESHOLDS)
        step = 8 if name.endswith(".jpg") else 1
        cells = np.flipud(read_map(file).cells)[::step, ::step]
        np.testing.assert_array_equal(cells, expected, err_msg=name)
        plan = np.flipud(read_floor_plan_image(tmp_path / name, 0.1).cells)[::step, ::step]
        np.testing.assert_array_equal(plan[1:-1, 1:-1], inner[1:-1, 1:-1], err_msg=name)


def test_a_transparent_grey_that_cannot_be_decoded_is_refused(tmp_path):
    Image.new("L", (4, 4), 200).save(tmp_path / "a.png", transparency=200)
    with pytest.raises(InputError, match=r"a\.png: its transparency cannot be decoded"):
        read_floor_plan_image(tmp_path / "a.png", 0.1)
