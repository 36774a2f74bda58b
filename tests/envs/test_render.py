"""Rendering of an env: films of whole episodes, and a window that may be closed at any time."""

import gymnasium
import numpy as np
import pytest

from tests.conftest import steps_of
from wheelchair_gym.scenes import SCENES, make_scene

SHORT = {"scene": "clutter", "task": {"time_base": 1.5, "time_factor": 0.0}}  # 15 steps


def env(**settings):
    return gymnasium.make("wheelchair_gym/Navigation-v1", config=SHORT, **settings)


# imageio_ffmpeg leaves its pipes to the garbage collector.
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("rate", [0.5, 2.5, 10.0])
def test_a_recorded_episode_plays_back_as_it_was_rendered(tmp_path, rate):
    pytest.importorskip("moviepy", reason="moviepy is not installed (extra: view)")
    import imageio_ffmpeg

    plain = env(render_mode="rgb_array", rate=rate, max_episode_steps=15)
    films = str(tmp_path / "films")
    world = gymnasium.wrappers.RecordVideo(plain, films, lambda _: True, disable_logger=True)
    world.reset(seed=0)
    rendered = [plain.render()]
    for _ in steps_of(world, np.array([0.3, 0.1], dtype=np.float32)):
        rendered.append(plain.render())
    world.close()
    (film,) = tmp_path.glob("films/*.mp4")
    reader = imageio_ffmpeg.read_frames(str(film))
    about = next(reader)
    width, height = about["size"]
    assert about["codec"] == "h264"
    assert about["fps"] == plain.metadata["render_fps"] == rate
    assert (height, width, 3) == rendered[0].shape
    played = [np.frombuffer(f, np.uint8).reshape(height, width, 3) for f in reader]
    assert len(played) == len(rendered) >= 2
    for seen, given in zip(played, rendered, strict=True):
        assert np.abs(seen.astype(int) - given).mean() < 3.0
    # The chair moved, and the film shows it.
    assert np.abs(played[0].astype(int) - played[-1]).max() > 100


def test_driving_goes_on_without_the_window_once_it_is_closed(monkeypatch):
    pygame = pytest.importorskip("pygame", reason="pygame-ce is not installed (extra: view)")
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    seen, unseen = env(render_mode="human"), env()
    begun = [world.reset(seed=0)[0] for world in (seen, unseen)]
    assert pygame.display.get_surface() is not None
    pygame.event.post(pygame.event.Event(pygame.QUIT))
    assert all((begun[0][key] == begun[1][key]).all() for key in begun[1])
    ahead = np.array([0.5, 0.2], dtype=np.float32)
    for _ in range(4):
        one, other = (world.step(ahead) for world in (seen, unseen))
        assert all((one[0][key] == other[0][key]).all() for key in other[0])
        assert not pygame.display.get_init()
    seen.reset()
    assert not pygame.display.get_init()
    for _ in "ab":
        seen.close()
    unseen.close()


ID = "wheelchair_gym/Navigation-v1"


@pytest.mark.parametrize("scene", sorted(SCENES))
def test_every_frame_of_every_scene_has_the_size_that_was_set(scene):
    episode = make_scene(scene).sample(np.random.default_rng(0))
    for height, width in ((640, 640), (64, 96)):
        size = {"render_height": height, "render_width": width}
        world = gymnasium.make(ID, scene="empty", render_mode="rgb_array", **size)
        world.reset(seed=0, options={"episode": episode})
        frame = world.render()
        assert frame.shape == (height, width, 3)
        assert len(np.unique(frame[::4, ::4].reshape(-1, 3), axis=0)) > 4  # a world, not a blank
