"""Proximal policy optimization (Schulman et al. 2017) in one file: give the number of updates."""

import sys

import torch
from torch import nn

from agents.learning.sb3 import flatten_observations
from wheelchair_gym.envs import NavigationVectorEnv

UPDATES, N, STEPS, GAMMA, LAMBDA, CLIP = int(sys.argv[1]), 16, 32, 0.99, 0.95, 0.2
torch.manual_seed(0)
envs = NavigationVectorEnv(N, scene="empty", beams=32, rate=5.0, scaled=True, bank=64)
net = nn.Sequential(
    nn.Linear(envs.task.observation_size, 64), nn.Tanh(), nn.Linear(64, 64), nn.Tanh()
)
mean, value, spread = nn.Linear(64, 2), nn.Linear(64, 1), nn.Parameter(torch.full((2,), -0.5))
parameters = [*net.parameters(), *mean.parameters(), *value.parameters(), spread]
optimizer = torch.optim.Adam(parameters, 1e-3)


def look(observation):
    """The distribution of actions, and the value, of observations (n, size)."""
    hidden = net(observation)
    return torch.distributions.Normal(mean(hidden), spread.exp()), value(hidden)[:, 0]


seen = torch.from_numpy(flatten_observations(envs.reset(seed=0)[0]))
begins = torch.zeros(N)  # 1: the step only begins an episode
for update in range(UPDATES):
    rows = []
    for _ in range(STEPS):
        with torch.no_grad():
            chances, worth = look(seen)
            action = chances.sample()
        told, reward, ended, truncated, _ = envs.step(action.numpy())
        reward, done = (torch.from_numpy(each).float() for each in (reward, ended))
        over = torch.from_numpy(ended | truncated).float()
        log = chances.log_prob(action).sum(1)
        rows.append((seen, action, log, worth, reward, done, over, begins))
        seen, begins = torch.from_numpy(flatten_observations(told)), over
    obs, act, old, worth, reward, done, over, useless = map(torch.stack, zip(*rows, strict=True))
    with torch.no_grad():
        after, gain, gains = look(seen)[1], torch.zeros(N), []
    for k in reversed(range(STEPS)):  # generalized advantages
        error = reward[k] + GAMMA * after * (1 - done[k]) - worth[k]
        gain = error + GAMMA * LAMBDA * (1 - over[k]) * gain
        after, gains = worth[k], [gain, *gains]
    gain, use = torch.stack(gains).flatten(), useless.flatten() == 0
    target = (gain + worth.flatten())[use]
    good = ((gain - gain.mean()) / (gain.std() + 1e-8))[use]
    for _ in range(4):
        chances, now = look(obs.flatten(0, 1)[use])
        ratio = (chances.log_prob(act.flatten(0, 1)[use]).sum(1) - old.flatten()[use]).exp()
        step = torch.minimum(ratio * good, ratio.clamp(1 - CLIP, 1 + CLIP) * good).mean()
        loss = -step + 0.5 * (now - target).pow(2).mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    print(f"update {update}: reward a step {reward.mean():.4f}")
