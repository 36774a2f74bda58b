"""A course of driving skills: two people dock at a desk, by the stick alone and with a manoeuvre.

python examples/skills.py
"""

from agents.evaluation.evaluate import drive_episode, env_settings, make_env
from agents.policies import make_policy
from wheelchair_gym.scenes.skill import COURSES

COURSE, SEEDS = "dock", range(2)

course = COURSES[COURSE]
print(f"{COURSE}: {course.title}; within {course.judged}")
for driver in ("expert", "essential_tremor"):
    settings = env_settings(
        driver=driver, shield=True, config={"task": {"time_base": 60.0, "time_factor": 10.0}}
    )
    env = make_env({"name": "skill", "course": COURSE}, settings, None)
    for assist in ("shield", "manoeuvre"):
        policy = make_policy({"name": "assisted", "assist": assist})
        drives = [drive_episode(env, policy, seed) for seed in SEEDS]
        done = sum(drive["success"] for drive in drives)
        effort = sum(drive["stick_effort"] for drive in drives) / len(drives)
        print(f"{driver:17} {assist:10} {done} of {len(drives)}, {effort:.1f} s/m of effort")
