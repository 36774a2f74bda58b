"""map_server files, and polygons from pixels."""

import contextlib

import cv2
import numpy as np
import pytest

from tests.conftest import put
from wheelchair_gym import maps
from wheelchair_gym.base.files import parse_json
from wheelchair_gym.base.settings import InputError

KEYS = {
    "image": "map.pgm",
    "resolution": 0.05,
    "origin": "[1.0, 2.0, 0.5]",
    "negate": 0,
    "occupied_thresh": 0.65,
    "free_thresh": 0.196,
}


def describe(folder, **changes):
    keys = {key: value for key, value in (KEYS | changes).items() if value is not None}
    return put(folder / "map.yaml", "".join(f"{k}: {v}\n" for k, v in keys.items()))


def put_map(folder, **changes):
    cv2.imwrite(str(folder / "map.pgm"), np.array([(254, 205), (0, 100)], dtype=np.uint8))
    return describe(folder, **changes)


@pytest.mark.parametrize("suffix", [".pgm", ".png"])
def test_what_is_written_is_read(tmp_path, suffix):
    cells = np.random.default_rng(0).choice([maps.FREE, maps.OCCUPIED, maps.UNKNOWN], (23, 17))
    grid = maps.OccupancyGrid(cells, 0.07, (-1.5, 2.25, 0.3))
    maps.write_map(grid, tmp_path / "some.yaml", suffix=suffix)
    again = maps.read_map(tmp_path / "some.yaml")
    assert (again.cells == grid.cells).all()
    assert (again.resolution, again.origin) == (grid.resolution, grid.origin)


def test_a_value_that_a_map_file_cannot_hold_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"some.yaml: mode trinary cannot hold .* 37"):
        maps.write_map(maps.OccupancyGrid(np.array([[37]]), 0.1), tmp_path / "some.yaml")


@pytest.mark.parametrize(("free_thresh", "grey_205"), [(0.25, maps.FREE), (0.196, maps.UNKNOWN)])
def test_grey_205_is_free_or_unknown_by_the_threshold(tmp_path, free_thresh, grey_205):
    said = pytest.warns(UserWarning, match=r"map\.yaml: free_thresh 0.25 reads the grey 205.* free")
    with said if grey_205 == maps.FREE else contextlib.nullcontext():
        grid = maps.read_map(put_map(tmp_path, free_thresh=free_thresh))
    assert grid.cells[1].tolist() == [maps.FREE, grey_205]  # the top row of the image is the last
    assert grid.cells[0].tolist() == [maps.OCCUPIED, maps.UNKNOWN]
    assert grid.origin == (1.0, 2.0, 0.5)


@pytest.mark.parametrize("negate", [0, 1])
@pytest.mark.parametrize("mode", ["trinary", "scale", "raw"])
def test_what_is_transparent_is_never_free(tmp_path, mode, negate):
    """Of every grey and opacity; in trinary what nav2_map_server makes occupied stays so."""
    grey, opacity = np.meshgrid(np.arange(256), np.array([0, 1, 64, 128, 200, 254, 255]))
    cv2.imwrite(str(tmp_path / "map.png"), np.dstack([grey, grey, grey, opacity]).astype(np.uint8))
    file = describe(tmp_path, image="map.png", mode=mode, negate=negate)
    cells = np.flipud(maps.read_map(file).cells)
    clear = opacity < 255
    assert not (cells[clear] == maps.FREE).any()
    assert (cells[~clear] == maps.FREE).any()
    shade = (3 * grey + opacity) / (4 * 255)
    nav2 = (shade if negate else 1.0 - shade) > KEYS["occupied_thresh"]
    if mode == "trinary":
        np.testing.assert_array_equal(cells[clear] == maps.OCCUPIED, nav2[clear])
    else:
        assert (cells[clear] == maps.UNKNOWN).all()
    cv2.imwrite(str(tmp_path / "map.png"), grey[:1].astype(np.uint8))
    # As without a fourth channel.
    np.testing.assert_array_equal(cells[-1:], maps.read_map(file).cells)


PLAIN = "".join(f"{key}: {value}\n" for key, value in (KEYS | {"mode": "trinary"}).items())


def respelled(rng, text):
    """Write the same YAML differently: numbers, blanks, comments, capitals, order of keys."""
    lines = []
    for line in text.splitlines():
        key, value = line.split(": ")
        if key == "mode":
            value = rng.choice([str.title, str.upper, str.lower])(value)
        elif key in ("resolution", "occupied_thresh", "free_thresh"):
            value = rng.choice(["{}", "{:e}", "+{}", "{:.3e}", "0{}"]).format(float(value))
        elif key == "origin":
            value = "[" + ",\t".join(f"{float(part):.1e}" for part in value[1:-1].split(",")) + "]"
        blank, end = rng.choice([" ", "\t", " \t "]), rng.choice(["", "\t", "\t# note", " # G\xe9"])
        lines.append(f"{key}:{blank}{value}{end}".encode("latin-1"))
    return b"\r\n".join(rng.permutation(np.array(lines, object)).tolist())


@pytest.mark.parametrize("seed", range(12))
def test_a_description_may_be_spelled_as_yaml_cpp_reads_it(tmp_path, seed):
    expected = maps.read_map(put_map(tmp_path))
    (tmp_path / "map.yaml").write_bytes(respelled(np.random.default_rng(seed), PLAIN))
    found = maps.read_map(tmp_path / "map.yaml")
    assert (found.cells == expected.cells).all()
    assert (found.resolution, found.origin) == (expected.resolution, expected.origin)


@pytest.mark.parametrize("key", [*KEYS, "mode"])
def test_a_key_that_is_given_twice_is_refused(tmp_path, key):
    (line,) = (line for line in PLAIN.splitlines() if line.startswith(f"{key}:"))
    put_map(tmp_path).write_text(f"{PLAIN}{line}\n")
    with pytest.raises(InputError, match=rf"map.yaml: line 8: .*the key '{key}' is given twice"):
        maps.read_map(tmp_path / "map.yaml")
    with pytest.raises(InputError, match=f"a.json: .*the key '{key}' is given twice"):
        parse_json(f'{{"{key}": 0, "more": [{{"{key}": 1}}], "{key}": 0}}', "a.json")


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"free_thresh": None}, "free_thresh is missing; 0.196 is used"),
        *(({"image": name}, "which is missing; .*map.pgm is used")
          for name in ("/nowhere/maps/map.pgm", "maps/map.pgm", r"C:\\none\\map.pgm")),
    ],
)  # fmt: skip
def test_what_a_description_lacks_is_said_and_found(tmp_path, changes, says):
    expected = maps.read_map(put_map(tmp_path)).cells
    with pytest.warns(UserWarning, match=says):
        assert (maps.read_map(put_map(tmp_path, **changes)).cells == expected).all()


@pytest.mark.filterwarnings("ignore:.*reads the grey 205")
@pytest.mark.parametrize(("name", "shape"), [("depot", (307, 604)), ("tb3_sandbox", (384, 384))])
def test_maps_of_others(shared, name, shape):
    grid = maps.read_map(shared / "maps" / f"{name}.yaml")
    assert grid.shape == shape
    assert {maps.FREE, maps.OCCUPIED} <= set(np.unique(grid.cells).tolist())


def drawn(found, shape, scale=20):
    """The polygons painted on a fine raster: cells' centres that are solid."""
    canvas = np.zeros((shape[0] * scale, shape[1] * scale), dtype=np.uint8)
    rings = [ring for outline in found for ring in (outline.outer, *outline.holes)]
    cv2.fillPoly(canvas, [np.rint(ring * scale).astype(np.int32) for ring in rings], 1)
    return canvas[scale // 2 :: scale, scale // 2 :: scale] > 0


@pytest.mark.parametrize("seed", range(6))
def test_polygons_without_tolerance_are_the_cells(seed):
    rng = np.random.default_rng(seed)
    solid = rng.random((9, 12)) < 0.35
    solid[:, 0] = solid[:, -1] = solid[0] = solid[-1] = False
    found = maps.occupied_polygons(
        maps.OccupancyGrid(np.where(solid, maps.OCCUPIED, maps.FREE), 1.0)
    )
    assert (drawn(found, solid.shape) >= solid).all()
    assert (drawn(found, solid.shape) == solid).mean() > 0.95


def test_polygons_keep_holes_grow_and_simplify():
    cells = np.full((60, 60), maps.FREE)
    cells[10:50, 10:50] = maps.OCCUPIED
    cells[20:40, 20:40] = maps.FREE
    cells[30, 10] = maps.FREE  # a notch
    grid = maps.OccupancyGrid(cells, 0.05, (1.0, 0.0, 0.0))
    exact = maps.occupied_polygons(grid)
    rough = maps.occupied_polygons(grid, epsilon=2.4)
    assert len(exact) == len(rough) == 1
    assert len(rough[0].outer) == 4 < len(exact[0].outer)
    assert len(rough[0].holes) == 1
    grown = maps.occupied_polygons(grid, dilate=2)
    assert grown[0].outer.min(axis=0) == pytest.approx((1.4, 0.4), abs=0.03)
    assert grown[0].outer.max(axis=0) == pytest.approx((3.6, 2.6), abs=0.03)
    assert np.ptp(grown[0].holes[0], axis=0) == pytest.approx((0.8, 0.8), abs=0.06)
    assert len(maps.occupied_polygons(grid, dilate=12)[0].holes) == 0
