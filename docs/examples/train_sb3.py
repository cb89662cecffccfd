"""Train an agent of stable-baselines3 to put pegs into holes, and see what it does then."""

import sys

import gymnasium
from stable_baselines3 import PPO

import treenail  # noqa: F401 (tells Gymnasium of the environment)

steps, insertions = (int(word) for word in sys.argv[1:3] or (20_000, 10))
env = gymnasium.make("treenail/PegInHole-v0", definition="suite-round", history=1, **{"limits.move_limit": 200})
env = gymnasium.wrappers.NormalizeReward(env)
model = PPO("MlpPolicy", env, n_steps=256, learning_rate=1e-3, seed=0)
model.learn(steps)

inserted, forces = 0, []
observation, info = env.reset(seed=1000)
for _ in range(insertions):
    over = False
    while not over:
        action, _ = model.predict(observation, deterministic=False)
        observation, reward, terminated, truncated, info = env.step(action)
        over = terminated or truncated
    inserted += info["inserted"]
    forces.append(info["mean_force_n"])
    observation, _ = env.reset()
print(f"after {steps} steps {inserted} of {insertions} inserted, mean force {sum(forces) / insertions:.2f} N")
