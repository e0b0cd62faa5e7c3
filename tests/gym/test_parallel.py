"""Several agents in one world: the bits of fleets and of the single environment, PettingZoo's tests, scenes, ends, errors."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pettingzoo.test import parallel_api_test, parallel_seed_test

from navstack.core import InputError, NavError, Pose2D, Twist2D
from navstack.gym import Level, LocalControlEnv, LocalControlParallelEnv, Scene, read_levels, read_scenes
from navstack.parameters import load_configuration
from navstack.sim import Lockstep, Shape, SimulatedRobot, World
from tests.gym.test_local_control import NOISE, bits, scans_of

FORWARD = np.array([1.0, 0.0], np.float32)
STILL = np.array([-1.0, 0.0], np.float32)


def scene(starts: list[Pose2D], world: World | None = None, **options: Any) -> Scene:
    """Robots that drive 4 m straight on, among a disc and a box."""
    world = world or World(None, [[9.0, 9.0, 0.1]], shapes=[Shape(box=[0.5, 0.5], pose=[2.0, 3.0, 0.4])])
    levels: list[Level] = []
    for k, start in enumerate(starts):
        goal = Pose2D(start.x + 4.0 * np.cos(start.yaw), start.y + 4.0 * np.sin(start.yaw), start.yaw)
        levels.append(Level(f"test {k}", world, start, goal, length=4.0, **options))
    return Scene("test", tuple(levels))


def head_on(**options: Any) -> Scene:
    """Two robots face each other, 2 m apart; a third is beside them."""
    return scene([Pose2D(0.0, 0.0, 0.0), Pose2D(2.0, 0.05, np.pi), Pose2D(0.5, 1.5, 0.3)], **options)


def everything(env: LocalControlParallelEnv, seed: int, steps: int) -> bytes:
    """The bits of all that random actions give."""
    rng = np.random.default_rng(seed)
    found: list[Any] = [part for _, part in sorted(env.reset(seed=seed)[0].items())]
    for _ in range(steps):
        actions = {name: rng.uniform(-1.0, 1.0, 2).astype(np.float32) for name in env.agents}
        observations, rewards, terminated, truncated, infos = env.step(actions)
        for name in observations:
            found += [observations[name], rewards[name], terminated[name], truncated[name], infos[name]["pose"]]
            found += [infos[name]["clearance"], infos[name]["contact"]]
        if not env.agents:
            found += [part for _, part in sorted(env.reset()[0].items())]
    return bits(*found)


# --- against the fleet and the single environment ---------------------------------------------------------------------


@pytest.mark.parametrize(
    "overrides",
    [[], ["navstack/sim/command_delay=0.13", "navstack/sim/velocity_lag=0.2", "navstack/sim/laser/delay=0.07"]],
    ids=["plain", "delays"],
)
def test_agents_move_and_see_as_the_robots_of_a_fleet(overrides: list[str]) -> None:
    """Poses, ranges and collisions to the bit; without noise, whose numbers are drawn otherwise."""
    met, clip = head_on(), 6.0
    env = LocalControlParallelEnv(levels=met, overrides=overrides, collision="stop", scan_clip=clip, beams=90)
    env.reset(seed=0)
    configuration = load_configuration(["jackal_dwa"], overrides=[*overrides, "navstack/sim/laser/beams=90"])
    sim = configuration.navstack.sim
    world, footprint = met.levels[0].world, configuration.local_costmap.true_footprint
    robots = {f"agent_{k}": SimulatedRobot(sim, world, footprint, level.start) for k, level in enumerate(met.levels)}
    lockstep = Lockstep(robots)
    rng = np.random.default_rng(1)
    actions = dict.fromkeys(robots, FORWARD)
    scans: dict[str, Any] = {name: scans_of(robot) for name, robot in robots.items()}
    contacts = set[str]()
    for step in range(80):
        if step % 10 == 9:
            actions = {name: rng.uniform(-0.5, 1.0, 2).astype(np.float32) for name in robots}
        for name, robot in robots.items():
            shares = 0.5 * (actions[name].astype(np.float64) + 1.0)
            robot.command(Twist2D(float(shares[0]), 0.0, float(-2.0 + shares[1] * 4.0)))
        lockstep.advance_to(lockstep.step_at(round(0.1 * (step + 1), 6)))
        lockstep.catch_up()
        observations, *_, infos = env.step(actions)
        for name, robot in robots.items():
            assert infos[name]["pose"].tolist() == list(robot.pose), (step, name)
            scans[name] = scans_of(robot) or scans[name]
            ranges = np.maximum(scans[name][-1].ranges.astype(np.float64), 0.0)
            assert (observations[name]["scan"] == (np.minimum(ranges, clip) / clip).astype(np.float32)).all(), (
                step,
                name,
            )
            assert infos[name]["collisions"] == len(robot.collisions)
            contacts.add(infos[name]["contact"])
    assert {"agent_0", "agent_1", ""} <= contacts


def test_one_agent_is_the_single_environment_to_the_bit() -> None:
    level = read_levels("barn", count=1)[0]
    options: dict[str, Any] = {
        "overrides": NOISE,
        "beams": 60,
        "plan": 3,
        "reward": "jaxnav",
        "flat": True,
        "randomize": {"velocity_lag": (0.0, 0.2), "command_delay": (0.0, 0.3)},
        "variants": 8,
        "max_episode_steps": 40,
    }
    env = LocalControlParallelEnv(levels=Scene("one", (level,)), **options)
    single = LocalControlEnv(levels=level, **options)
    rng = np.random.default_rng(0)
    assert bits(env.reset(seed=7)[0]["agent_0"]) == bits(single.reset(seed=7)[0])
    ended = 0
    for _ in range(150):
        action = rng.uniform(-0.4, 1.0, 2).astype(np.float32)
        found = env.step({"agent_0": action})
        wanted = single.step(action)
        assert bits(*(part["agent_0"] for part in found[:4])) == bits(*wanted[:4])
        info = dict(found[4]["agent_0"])
        assert info.pop("contact") == ("world" if info["collisions"] else "")
        assert info.keys() == wanted[4].keys() and info["reward_terms"] == wanted[4]["reward_terms"]
        for key in info.keys() - {"reward_terms", "scenario"}:
            assert bits(info[key]) == bits(wanted[4][key]), key
        if wanted[2] or wanted[3]:
            ended += 1
            assert bits(env.reset()[0]["agent_0"]) == bits(single.reset()[0])
    assert ended > 2


def test_the_same_seed_gives_the_same_bits() -> None:
    options: dict[str, Any] = {
        "levels": ["crossing", "random"],
        "agents": 3,
        "count": 1,
        "overrides": NOISE,
        "beams": 30,
        "flat": True,
        "randomize": {"footprint_scale": (0.8, 1.0), "velocity_lag": (0.0, 0.2), "command_delay": (0.0, 0.3)},
    }
    first, second = LocalControlParallelEnv(**options), LocalControlParallelEnv(**options)
    everything(second, 1, 20)  # what happened before does not matter
    assert everything(first, 5, 60) == everything(second, 5, 60) != everything(first, 6, 60)


# --- PettingZoo -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("options", [{}, {"flat": True, "actions": "discrete", "collision": "stop", "ended": "leaves"}])
def test_pettingzoo_has_no_complaint(options: dict[str, Any], capsys: pytest.CaptureFixture[str]) -> None:
    """Warnings are errors."""

    def make() -> LocalControlParallelEnv:
        return LocalControlParallelEnv(agents=4, count=2, levels="crossing", beams=30, max_episode_steps=80, **options)

    parallel_api_test(make(), num_cycles=200)
    parallel_seed_test(make)
    assert "Passed" in capsys.readouterr().out


# --- ends -------------------------------------------------------------------------------------------------------------


def run(env: LocalControlParallelEnv, actions: dict[str, Any], steps: int) -> dict[str, dict[str, Any]]:
    """The last `info` of each agent."""
    env.reset(seed=0)
    found: dict[str, dict[str, Any]] = {}
    for _ in range(steps):
        if env.agents:
            found |= env.step({name: actions[name] for name in env.agents})[-1]
    return found


def test_a_contact_ends_the_episode_of_who_drives_into_the_other() -> None:
    env = LocalControlParallelEnv(levels=head_on(), reward="jaxnav")
    infos = run(env, {"agent_0": FORWARD, "agent_1": STILL, "agent_2": STILL}, 30)
    assert infos["agent_0"]["outcome"] == "collision" and infos["agent_0"]["contact"] == "agent_1"
    assert infos["agent_0"]["reward_terms"]["collision"] == -4.0 and infos["agent_0"]["scenario"] == "test"
    assert env.agents == ["agent_1", "agent_2"]
    assert infos["agent_1"]["collisions"] == 0 and infos["agent_1"]["clearance"] < 0.02  # a contact stops short of 0


def test_robots_that_have_ended_stay_or_leave() -> None:
    """agent_0 reaches its goal beside agent_1, which sees it there, or not."""
    world = World(None, [[9.0, 9.0, 0.1]])
    levels = scene([Pose2D(0.0, 0.0, 0.0), Pose2D(6.5, 0.0, np.pi)], world).levels
    seen: dict[str, float] = {}
    for ended in ("stays", "leaves"):
        env = LocalControlParallelEnv(levels=Scene("test", levels), ended=ended, beams=181, scan_clip=8.0)
        observations, infos = env.reset(seed=0)
        while "agent_0" in env.agents:
            observations, *_, infos = env.step({"agent_0": FORWARD, "agent_1": STILL})
        assert infos["agent_0"]["outcome"] == "goal" and infos["agent_0"]["is_success"]
        for _ in range(5):
            observations, *_ = env.step({"agent_1": STILL})
        seen[ended] = float(observations["agent_1"]["scan"][90]) * 8.0
    assert 1.5 < seen["stays"] < 2.8 and seen["leaves"] == 8.0


def test_low_robots_are_not_seen_by_high_lidars() -> None:
    for height, sees in ((0.1, False), (1.0, True)):
        options = [f"navstack/sim/body_height={height}", "navstack/sim/laser/height=0.5"]
        env = LocalControlParallelEnv(levels=head_on(), overrides=options, beams=181)
        observations, _ = env.reset(seed=0)
        assert (observations["agent_0"]["scan"][90] < 0.5) == sees


# --- scenes -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["crossing", "corridor", "narrow_door", "random", "warehouse", "map:office"])
def test_drawn_scenes_have_room_for_every_robot(name: str) -> None:
    radius = 0.3
    train = read_scenes(name, agents=5, split="train", count=2, radius=radius)
    held_out = read_scenes(name, agents=5, split="held_out", count=1, radius=radius)
    again = read_scenes(name, agents=5, split="all", count=3, radius=radius)
    assert [s.name for s in again] == [train[0].name, held_out[0].name, train[1].name]
    for one, other in zip(again, (train[0], held_out[0], train[1]), strict=True):
        assert [(level.start, level.goal) for level in one.levels] == [
            (level.start, level.goal) for level in other.levels
        ]
    assert again[0].levels[0].start != again[1].levels[0].start
    for found in again:
        for poses in ([level.start for level in found.levels], [level.goal for level in found.levels]):
            assert min(a.distance_to(b) for a, b in itertools.combinations(poses, 2)) > 2.0 * radius
            world = found.levels[0].world
            clear = world.clearances(np.array(poses), None, world.solids_at(0.0)) - radius
            assert clear.min() > 0.0
        for level in found.levels:
            assert level.length >= 0.95 * level.start.distance_to(level.goal) - 0.2 and len(level.path) >= 2
            assert level.start.distance_to(level.goal) >= 1.9 and level.world is found.levels[0].world


def test_fleet_files_are_scenes(tmp_path: Path) -> None:
    (door,) = read_scenes("narrow_door_eight")
    assert len(door.levels) == 8 and door.levels[0].start == Pose2D(1.5, 7.4, 3.14)
    file = tmp_path / "two.yaml"
    file.write_text(
        "map: office\nrobots:\n  - {start: [0.8, 7.4, 0.0], goals: [[5.0, 7.4, 0.0]]}\n  - {start: [5.0, 7.4, 0.0]}\n"
    )
    with pytest.raises(InputError, match=r"robot_2 of .* has no goal"):
        read_scenes(file)
    (lanes,) = read_scenes("warehouse_lanes")
    assert len(lanes.levels) == 20 and lanes.levels[0].goal.x != 0.0


# --- pictures, wrong input --------------------------------------------------------------------------------------------


def test_a_picture_shows_the_robots() -> None:
    env = LocalControlParallelEnv(levels=head_on(), render_mode="rgb_array", ended="leaves", beams=30)
    env.reset(seed=0)
    before = env.render()
    assert before is not None and before.shape[0] == 480 and before.dtype == np.uint8
    run(env, dict.fromkeys(env.possible_agents, FORWARD), 12)
    after = env.render()
    assert after is not None and (before != after).any()
    blue = np.array([31, 119, 180])  # the second robot has left after its collision

    def area(picture: Any) -> int:
        return int((np.abs(picture.astype(int) - blue).max(axis=2) < 3).sum())

    assert area(after) < 0.8 * area(before)
    env.close()
    env.close()


def test_wrong_input_has_one_message() -> None:
    levels = head_on()
    for options, message in (
        ({"levels": levels, "agents": 2}, "test has 3 robots, but agents is 2; leave agents out"),
        ({"levels": [levels, Scene("two", levels.levels[:2])]}, "different numbers of robots (test: 3, two: 2)"),
        ({"levels": []}, "the list of scenes is empty"),
        ({"levels": "corridr"}, 'did you mean "corridor"'),
        ({"levels": "crossing", "agents": 0}, "agents is 0; it must be at least 1"),
        ({"levels": levels, "ended": "gone"}, '"stays" or "leaves"'),
        ({"levels": levels, "render_mode": "human"}, '"rgb_array"'),
        ({"levels": levels, "agent": 2}, 'did you mean "agents"'),
        ({"levels": scene([Pose2D(0.0, 0.0, 0.0), Pose2D(0.3, 0.0, 0.0)])}, "test 0 and test 1 overlap"),
    ):
        with pytest.raises(NavError) as error:
            LocalControlParallelEnv(**options)  # pyright: ignore[reportArgumentType]
        assert message in error.value.message and "\n" not in error.value.message
    env = LocalControlParallelEnv(levels=levels, render_mode="rgb_array", beams=30)
    with pytest.raises(InputError, match="call reset"):
        env.step({})
    with pytest.raises(InputError, match="call reset"):
        env.render()
    env.reset()
    with pytest.raises(InputError, match="missing or too many: agent_2"):
        env.step({"agent_0": FORWARD, "agent_1": FORWARD})
    with pytest.raises(InputError, match="is not finite"):
        env.step({"agent_0": FORWARD, "agent_1": FORWARD, "agent_2": np.array([np.nan, 0.0], np.float32)})
    with pytest.raises(InputError, match="there is no level"):
        env.reset(options={"level": "tset"})
    env.close()
    with pytest.raises(InputError, match="closed"):
        env.reset()
