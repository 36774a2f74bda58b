"""Pictures of the chair and of plans, a window to watch them in, and video files."""

from wheelchair_gym.rendering.picture import PlanPicture, TopView, draw_map
from wheelchair_gym.rendering.video import Window, video_suffix, write_png, write_video

__all__ = [
    "PlanPicture",
    "TopView",
    "Window",
    "draw_map",
    "video_suffix",
    "write_png",
    "write_video",
]
