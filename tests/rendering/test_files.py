"""Files are whole, hold the pictures given, and windows close for good."""

import io
import math
import sys

import cv2
import numpy as np
import pytest
from PIL import Image, ImageSequence

from agents.evaluation.compare import webp
from wheelchair_gym.base.settings import InputError
from wheelchair_gym.rendering import Window, write_png, write_video


def frames(count=12, shape=(64, 96)):
    for k in range(count):
        image = np.full((*shape, 3), 30, dtype=np.uint8)
        image[:, : 8 * k] = (200, 90, 20)
        yield image


def test_png_returns_the_same_pixels(tmp_path):
    image = np.random.default_rng(0).integers(0, 256, (20, 30, 3)).astype(np.uint8)
    write_png(tmp_path / "deep" / "a.png", image)
    assert (cv2.imread(str(tmp_path / "deep" / "a.png"))[..., ::-1] == image).all()


# imageio_ffmpeg leaves its pipes to the garbage collector.
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("shape", [(64, 96), (65, 97)])
def test_mp4_is_h264_with_every_frame(tmp_path, shape):
    ffmpeg = pytest.importorskip("imageio_ffmpeg")
    path = tmp_path / "a.mp4"
    write_video(path, frames(12, shape), 10)
    data = path.read_bytes()
    assert data.index(b"moov") < data.index(b"mdat")  # plays before it is loaded
    reader = ffmpeg.read_frames(str(path))
    about = next(reader)
    assert about["codec"] == "h264"
    assert about["pix_fmt"].startswith("yuv420p")
    assert about["fps"] == 10
    assert about["size"] == (96, 64)
    shown = [np.frombuffer(f, np.uint8).reshape(64, 96, 3) for f in reader]
    assert len(shown) == 12
    for image, given in zip(shown, frames(), strict=True):
        assert np.abs(image[32].astype(int) - given[32]).mean() < 12


@pytest.mark.parametrize("rate", [0.5, 2.5, 10, 12.0, 75.0, 200.0])
def test_gif_keeps_frames_and_pace(tmp_path, rate):
    write_video(tmp_path / "a.gif", frames(), rate)
    with Image.open(tmp_path / "a.gif") as gif:
        assert gif.n_frames == 12 // math.ceil(rate / 50)
        shown = [image.info["duration"] for image in ImageSequence.Iterator(gif)]
        assert min(shown) >= 20  # ms
        assert sum(shown) == pytest.approx(1000 * 12 / rate, abs=5.1)


def test_what_stands_still_keeps_its_colours_in_a_gif(tmp_path):
    rng = np.random.default_rng(0)
    still = rng.integers(0, 256, (64, 24, 3)).astype(np.uint8)
    pictures = [np.concatenate([still, image], axis=1) for image in frames()]
    write_video(tmp_path / "a.gif", pictures, 10)
    with Image.open(tmp_path / "a.gif") as gif:
        shown = [np.asarray(f.convert("RGB"))[:, :24] for f in ImageSequence.Iterator(gif)]
    assert (np.array(shown) == shown[0]).all()


@pytest.mark.parametrize("suffix", [".mp4", ".gif"])
def test_a_broken_run_leaves_nothing_behind(tmp_path, suffix):
    def broken():
        yield from frames(3)
        raise RuntimeError("no more")

    path = tmp_path / f"a{suffix}"
    path.write_bytes(b"old")
    with pytest.raises(RuntimeError, match="no more"):
        write_video(path, broken(), 10)
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(("name", "count"), [("a.avi", 3), ("a.mp4", 0)])
def test_what_cannot_be_written_is_said(tmp_path, name, count):
    with pytest.raises(InputError, match=name):
        write_video(tmp_path / name, frames(count), 10)


def test_window_shows_and_closes_for_good(monkeypatch):
    pygame = pytest.importorskip("pygame")
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    image = next(frames())
    for key in (pygame.K_q, pygame.K_ESCAPE):
        window = Window()
        assert window.show(image)
        shown = pygame.surfarray.array3d(pygame.display.get_surface())
        assert (shown.transpose(1, 0, 2) == image).all()
        pygame.event.post(pygame.event.Event(pygame.KEYDOWN, key=key))
        assert not window.show(image)
        assert not window.is_open
        assert not window.show(image)
        window.close()
        window.close()


def test_without_a_display_a_window_is_refused_at_once(monkeypatch):
    pytest.importorskip("pygame")
    monkeypatch.setattr(sys, "platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "SDL_VIDEODRIVER"):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(InputError, match="no display to open a window on"):
        Window()


def test_webp_is_small_and_looks_the_same(tmp_path):
    noisy = np.kron(np.arange(48).reshape(6, 8, 1) * 5, np.ones((40, 40, 3))).astype(np.uint8)
    write_png(tmp_path / "a.png", noisy)
    data = webp(tmp_path / "a.png")
    assert data[:4] == b"RIFF"
    assert data[8:12] == b"WEBP"
    with Image.open(io.BytesIO(data)) as picture:
        assert np.abs(np.asarray(picture).astype(int) - noisy).mean() < 3
