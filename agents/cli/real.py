"""An environment of a real chair, as several subcommands drive one."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


def drive_real(named: Any, settings: Mapping[str, Any], **more: Any) -> tuple[Any, Any]:
    """An environment with a shield over a real chair, and the chair itself.

    From now on SIGTERM and SIGHUP end this program as Ctrl-C does, so that the chair is told to
    stop, and a person at the terminal re-arms it.

    Args:
        named: the chair, as `make_chair` takes it.
        settings: of the environment, as `agents.evaluation.evaluate.env_settings` gives them.
        more: further arguments of the environment.

    Raises:
        InputError: the spec is wrong, or nothing answers there.
    """
    from agents.deploy import ended_as_by_hand, hear_person
    from wheelchair_gym.envs import NavigationEnv
    from wheelchair_gym.envs.settings import env_settings
    from wheelchair_gym.hardware.registry import make_chair

    ended_as_by_hand()
    own = env_settings(**{"config": None, **settings})
    chair: Any = make_chair(named, own)
    try:
        shield: Any = own.shield or True  # nobody is driven without one
        env = NavigationEnv(chair=chair, **{**settings, **more, "shield": shield})
        hear_person(chair, env.shield)
        return env, chair
    except BaseException:
        chair.close()
        raise
