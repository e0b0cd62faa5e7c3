"""Train a policy for the BARN worlds with PPO of stable-baselines3, and export it to ONNX.

    pip install 'navstack[gym]' torch stable-baselines3 onnx
    python examples/learning/train.py --seed 0 --minutes 25 --out policy_0.onnx

The training worlds are generated as BARN's were; none of the published ones is among them. Every few minutes the policy drives
through generated worlds that it has not seen; their success rates are written next to the policy, as a table.
"""

from __future__ import annotations

import argparse
import csv
import time
from pathlib import Path

import numpy as np

from navstack.gym import stable_baselines_env

try:
    import torch
    from stable_baselines3 import PPO
    from stable_baselines3.common.callbacks import BaseCallback
    from stable_baselines3.common.vec_env import VecEnv, VecMonitor
except ModuleNotFoundError as error:
    raise SystemExit(f"{error.name} is not installed; pip install torch stable-baselines3 onnx") from None

TASK = {
    "robot": "jackal_dwa",
    "period": 0.1,
    "beams": 120,
    "scan_clip": 4.0,
    "goal_range": 10.0,
    "plan": 5,
    "flat": True,
    "reward": {"goal": 10.0, "collision": -5.0, "progress": 1.0, "time": -0.02, "discomfort": 5.0},
    "randomize": {"laser/range_noise": (0.0, 0.03), "velocity_lag": (0.0, 0.1)},
    "max_episode_steps": 400,
}
"""What the policy sees, does and is rewarded for; `policy.yaml` says the same to the controller."""


class Progress(BaseCallback):
    """Stops in time; measures the success on held-out worlds, and exports the policy each time."""

    def __init__(self, minutes: float, every: float, file: Path, seed: int) -> None:
        super().__init__()
        self.ends, self.every = 60.0 * minutes, 60.0 * every
        self.file, self.rows = file, list[dict[str, float]]()
        self.held_out = stable_baselines_env(50, split="held_out", count=50, level_seed=seed, **TASK)

    def _on_training_start(self) -> None:
        self.begin, self.next, self.processor = time.monotonic(), 0.0, time.process_time()

    def _on_step(self) -> bool:
        passed = time.monotonic() - self.begin
        if passed >= self.next:
            self.next = passed + self.every
            self.measure(passed)
        return passed < self.ends

    def measure(self, passed: float) -> None:
        """Drive through every held-out world once."""
        ends = drive_once(self.model, self.held_out)
        row = {
            "minutes": round(passed / 60.0, 2),
            "processor_minutes": round((time.process_time() - self.processor) / 60.0, 2),
            "steps": self.num_timesteps,
            "success": float(np.mean([end["is_success"] for end in ends])),
            "collision": float(np.mean([end["outcome"] == "collision" for end in ends])),
        }
        self.rows.append(row)
        print(row, flush=True)
        with self.file.with_suffix(".csv").open("w", newline="") as file:
            writer = csv.DictWriter(file, list(row))
            writer.writeheader()
            writer.writerows(self.rows)
        export(self.model, self.file)


def drive_once(model: PPO, env: VecEnv) -> list[dict]:
    """Drive world i with environment i; how each episode ended."""
    env.set_options({"level": list(range(env.num_envs))})
    env.seed(0)
    observations = env.reset()
    ends: list[dict | None] = [None] * env.num_envs
    while None in ends:
        actions, _ = model.predict(observations, deterministic=True)
        observations, _, dones, infos = env.step(actions)
        for i in np.flatnonzero(dones):
            ends[i] = ends[i] or infos[i]
    return ends


class Exported(torch.nn.Module):
    """The deterministic policy: observation -> action in [-1, 1]."""

    def __init__(self, policy: torch.nn.Module) -> None:
        super().__init__()
        self.policy = policy

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        return self.policy(observation, deterministic=True)[0].clamp(-1.0, 1.0)


def export(model: PPO, file: Path) -> None:
    """Write the policy as ONNX, with the input `observation` and the output `action`."""
    example = torch.zeros(1, model.observation_space.shape[0])
    torch.onnx.export(
        Exported(model.policy).eval(),
        (example,),
        str(file),
        input_names=["observation"],
        output_names=["action"],
        dynamo=False,
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--minutes", type=float, default=25.0)
    parser.add_argument("--worlds", type=int, default=300)
    parser.add_argument("--envs", type=int, default=128)
    parser.add_argument("--out", type=Path, default=Path("policy.onnx"))
    options = parser.parse_args()
    torch.set_num_threads(1)  # small networks; the other core simulates
    env = stable_baselines_env(options.envs, split="train", count=options.worlds, **TASK)
    env.seed(options.seed)
    model = PPO(
        "MlpPolicy",
        VecMonitor(env),
        n_steps=64,
        batch_size=1024,
        n_epochs=6,
        learning_rate=5e-4,
        gamma=0.99,
        gae_lambda=0.95,
        ent_coef=0.001,
        policy_kwargs={"net_arch": [128, 128], "log_std_init": -0.5},
        seed=options.seed,
        device="cpu",
    )
    model.learn(10**9, callback=Progress(options.minutes, 2.0, options.out, seed=1))
    model.save(options.out.with_suffix(".zip"))
    export(model, options.out)


if __name__ == "__main__":
    main()
