"""Settings of the task: what is observed, when it ends, what is rewarded."""

import math

from wheelchair_gym.base.settings import setting, settings
from wheelchair_gym.sensors.settings import SensorSettings
from wheelchair_gym.task.prepared_episode import Aim
from wheelchair_gym.task.rewards import RewardWeights


@settings
class TaskSettings:
    """Navigation to a goal."""

    beams: int = setting(default=1081, low=1, source="data sheet: Hokuyo UST-10LX")
    """Observed beams of the laser; fewer than it has are pooled by their minimum. The beams of each
    further scanner (`sensors.more_lasers`) follow, pooled in the same proportion."""
    tolerance: float = setting(default=0.30, unit="m", low=0.01)
    """Distance at which the goal counts as reached."""
    arrival_margin: float = setting(
        default=0.10, unit="m", low=0.0, source="largest error of an estimated pose (`modelled`)"
    )
    """How much nearer than the tolerance an estimated pose must be to count as arrived."""
    heading: bool = setting(default=False)
    """True: the goal's heading counts, too."""
    heading_tolerance: float = setting(default=math.radians(15.0), unit="rad", low=0.01)
    """Error of heading at which the goal counts as reached, where the heading counts."""
    time_base: float = setting(default=30.0, unit="s", low=0.1)
    """Time limit of an episode without a way to go."""
    time_factor: float = setting(default=3.0, low=0.0)
    """Time limit added for each second at full speed along the geodesic."""
    max_episode_steps: int | None = setting(default=None, low=1, source="Gymnasium's TimeLimit")
    """Steps after which an episode is truncated, without the reward of a timeout; null: none."""
    bump_ends: bool = setting(default=True)
    """Whether a pressed bumper strip ends an episode; false where a person drives on by hand."""
    look_ahead: tuple[float, ...] = setting(default=(0.5, 1.0, 1.5, 2.0, 3.0), unit="m", low=0.0)
    """Distances along the guidance path at which its points are observed."""
    look_ahead_time: tuple[float, ...] = setting(
        default=(0.5, 1.0, 2.0, 3.5, 5.0), unit="s", low=0.0
    )
    """Plan times at which poses of the guidance are observed, where it gives poses."""
    scaled: bool = setting(default=False)
    """True: every number is observed times a factor that makes it of order 1, as networks need it:
    ranges and the goal's distance in units of 5 m, places in units of 2 m, clearances of 0.25 m."""
    last_action: bool = setting(default=False)
    """True: the last action is observed."""
    shield_state: bool = setting(default=False)
    """True: whether a shield filters (1 or 0) and what it took off the last twist, in full speeds
    ahead and of turning, are observed."""
    side_clearance: bool = setting(default=False)
    """True: how far the outline could move to the left and to the right before it touches what the
    scan shows is observed, where it stands and at each pose ahead; without poses ahead, at a fan
    of poses that it may take next."""
    trail: tuple[float, ...] = setting(default=(), unit="m", low=0.0, high=15.0)
    """Distances back along its own way at which the chair's places are observed; before it has come
    so far, its start."""
    tracks: int = setting(default=0, low=0, high=20)
    """How many of the nearest moving things are observed, as the tracker finds them in the scans of
    the first laser, without a map, at 1 Hz at least; 0: none, and no tracker runs."""
    hide_guidance: bool = setting(default=False)
    """True: poses ahead and the side clearances there are shown to critics and teachers alone,
    under `privileged_path` and `privileged_side_clearance`."""
    privileged: bool = setting(default=False)
    """True: a critic's keys are observed; in training only."""
    aim: Aim = setting(default="field")
    """Measure of progress: along the straight line to the goal, the path or the geodesic, or in
    seconds to go by the guidance 'poses'."""
    margin: float = setting(default=0.05, unit="m", low=0.0)
    """Clearance that the geodesic keeps beyond half the chair's width."""
    reward: RewardWeights = RewardWeights()

    def observed_beams(self, sensors: SensorSettings) -> tuple[int, ...]:
        """Return how many numbers of an observation each scanner of a chair gives."""
        if not sensors.lasers:
            return ()
        share = self.beams / sensors.laser.beams
        more = (max(1, round(share * laser.beams)) for laser in sensors.more_lasers)
        return (self.beams, *more)
