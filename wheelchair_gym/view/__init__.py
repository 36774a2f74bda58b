"""Pictures of the chair and of plans, a window to watch them in, and video files."""

from wheelchair_gym.view.picture import TopView
from wheelchair_gym.view.plan import draw_plan
from wheelchair_gym.view.survey import draw_map
from wheelchair_gym.view.video import contact_sheet, video_suffix, webp, write_png, write_video
from wheelchair_gym.view.window import Window

__all__ = [
    "TopView",
    "Window",
    "contact_sheet",
    "draw_map",
    "draw_plan",
    "video_suffix",
    "webp",
    "write_png",
    "write_video",
]
