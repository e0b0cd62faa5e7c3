"""Draw the pictures of the documentation: `python tools/docs/pictures.py [FOLDER]` (default: docs/images).

Each picture is the output of a command, so that a reader can reproduce it.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

IMAGES = Path(__file__).resolve().parents[2] / "docs" / "images"


def navstack(*arguments: str | Path, code: int = 0) -> None:
    """Run a command; its exit code must be `code`."""
    print("navstack", *arguments)
    done = subprocess.run([sys.executable, "-m", "navstack", *map(str, arguments)], stdout=subprocess.DEVNULL)
    if done.returncode != code:
        sys.exit(f"exit code {done.returncode}, not {code}")


def _localization(images: Path, folder: Path) -> None:
    """Draw the pictures of the tutorial on localization, except those of foreign logs."""
    text = (IMAGES.parent / "tutorials" / "localization.md").read_text(encoding="utf-8")
    parameters = folder / "localization.yaml"
    parameters.write_text(text.split('```yaml title="localization.yaml"\n')[1].split("```")[0], encoding="utf-8")
    drive, out = folder / "drive", folder / "localize"
    robot = ("--params", "turtlebot", "--params", parameters)
    navstack("simulate", "office", *robot, "--out", drive)
    shutil.copy(drive / "run.png", images / "localization_run.png")
    navstack("plot", drive, "--localization", images / "localization_moment.png", "--time", "1.0")
    compared = ("--set", "method=amcl_only", "--versus", "method=dead_reckoning")
    navstack("localize", drive, *robot, *compared, "--out", out)
    shutil.copy(out / "localize.png", images / "localization_versus.png")
    navstack("localize", drive, "--global", "--starts", "50", "--out", out)
    shutil.copy(out / "starts.png", images / "localization_starts.png")
    navstack("localize", drive, "--global", "--to", "10", "--animate", images / "localization_start.gif")


def _speed(images: Path) -> None:
    """Draw the table of the benchmarks page that compares the stages with C++."""
    import matplotlib as mpl
    from matplotlib.figure import Figure

    text = (IMAGES.parent / "benchmarks" / "index.md").read_text(encoding="utf-8")
    section = text[text.index("## Against C++") :].split("\n## ")[0]
    rows = [(stage, float(ratio)) for stage, ratio in re.findall(r"^\| (.+?) \| ([\d.]+) \|$", section, re.MULTILINE)]
    with mpl.rc_context({"font.size": 8}):
        figure = Figure(figsize=(7.2, 0.2 * len(rows) + 0.7), layout="constrained")
        axes = figure.add_subplot()
        bars = axes.barh([stage for stage, _ in rows], [ratio for _, ratio in rows], color="#0072b2", height=0.7)
        axes.bar_label(bars, fmt="%gx", padding=3)
        axes.axvline(1.0, color="#d55e00", lw=1.2)
        axes.text(1.0, -0.9, "C++", color="#d55e00", ha="center")
        axes.invert_yaxis()
        axes.set_xlabel("speed as a multiple of that of C++")
        axes.spines[["top", "right"]].set_visible(False)
        axes.margins(y=0.01)
        figure.savefig(images / "speed.png", dpi=150)


def _camera(images: Path) -> None:
    """Draw what the camera of the page on the simulator sees: color, and depth from near (dark) to far."""
    import numpy as np
    from PIL import Image

    import navstack as nav
    from navstack.sim import PedestrianMotion

    shapes = [
        nav.Shape(box=[0.5, 0.4], pose=[4.3, 7.0, 0.3]),
        nav.Shape(box=[0.6, 0.4], pose=[2.7, 7.15, 0.2], height=0.1),
        nav.Shape(radius=0.18, pose=[3.1, 8.0], height=0.45),
        nav.Shape(radius=0.25, pose=[4.7, 7.75], motion=PedestrianMotion(goals=[[1.0, 7.5]])),
    ]
    params = nav.load_configuration(["turtlebot"])
    start = nav.load_places("office").start
    picture = nav.simulated_robot(params, nav.load_map(nav.map_path("office")), start, shapes=shapes).camera()
    gray = np.uint8(255.0 * np.clip(picture.depth / picture.params.range_max, 0.0, 1.0))
    both = np.concatenate((picture.rgb, np.repeat(gray[:, :, None], 3, axis=2)), axis=1)
    Image.fromarray(both).save(images / "camera.png", optimize=True)


def main() -> None:
    """Draw every picture."""
    images = Path(sys.argv[1]) if len(sys.argv) > 1 else IMAGES
    images.mkdir(parents=True, exist_ok=True)
    _speed(images)
    _camera(images)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        navstack("simulate", "office", "--out", folder / "office")
        shutil.copy(folder / "office" / "run.png", images / "office.png")
        navstack("explain", "goal", folder / "office", "--out", images / "goal.png")
        navstack("plot", folder / "office", "--style", "paper", "--out", images / "paper.png")
        navstack("plot", "office", "--out", images / "map.png")
        navstack("simulate", "narrow_door", "--out", folder / "door")
        navstack("explain", "command", folder / "door", "--time", "3.2", "--out", images / "narrow_door.png")
        navstack("simulate", "narrow_door", "--params", "turtlebot_mppi", "--out", folder / "mppi")
        navstack("explain", "command", folder / "mppi", "--time", "1.6", "--out", images / "mppi.png")
        navstack("explain", "passages", "office", "--out", folder / "passages")
        shutil.copy(next((folder / "passages").glob("*.png")), images / "passages.png")
        navstack("explain", "inflation", "--out", folder / "inflation")
        shutil.copy(next((folder / "inflation").glob("*.png")), images / "inflation.png")
        navstack(
            *("plan", "office", "--start", "0.8,7.45", "--goal", "20.6,2.2", "--out", folder / "compare"),
            *("--compare", "navfn,global_planner,astar,theta_star"),
        )
        shutil.copy(next((folder / "compare").glob("*.png")), images / "compare.png")
        noise = ("wheel_slip=0.05", "odometry_noise=0.05", "wheel_slip_turn=0.02", "odometry_noise_turn=0.02")
        navstack(
            *("follow", "figure_eight", "--speed", "0.4", "--out", folder / "follow"),
            *(part for value in noise for part in ("--set", f"navstack/sim/{value}")),
        )
        shutil.copy(folder / "follow" / "tracking.png", images / "tracking.png")
        navstack("simulate", "car_park", "--out", folder / "car")
        navstack("plot", folder / "car", "--out", images / "car_park.png", "--steering", images / "car_steering.png")
        for name in ("long_robot", "long_robot_navfn"):
            navstack("simulate", name, "--out", folder / f"{name}_run")
            navstack("plot", folder / f"{name}_run", "--out", images / f"{name}.png")
        navstack(
            *("plan", "office", "--start", "2.5,10,-1.57", "--goal", "7,9.9,1.57", "--planner", "smac_hybrid"),
            *("--footprint", "[[0.8,0.5],[0.8,-0.5],[-0.2,-0.5],[-0.2,0.5]]", "--out", images / "plan_too_narrow.png"),
            code=1,
        )
        navstack(
            *("explain", "passages", "office", "--footprint", "1.2x0.7", "--turning-radius", "0.6"),
            *("--narrowest", "0.6", "--out", images / "passages_footprint.png"),
        )
        navstack("info", "--states", images / "states.png")
        navstack("dock", "--noise", "0.03", "--seed", "3", "--out", folder / "dock")
        shutil.copy(folder / "dock" / "dock.png", images / "docking.png")
        _localization(images, folder)
        # the files of the tutorial on safety
        text = (IMAGES.parent / "tutorials" / "safety.md").read_text(encoding="utf-8")
        section = text[text.index("## Something steps into the way") :]
        zones, cart = (part.split("```")[0] for part in section.split("```yaml\n")[1:3])
        (folder / "zones.yaml").write_text(zones, encoding="utf-8")
        (folder / "cart.yaml").write_text(cart, encoding="utf-8")
        navstack("simulate", folder / "cart.yaml", "--out", folder / "cart")
        navstack("plot", folder / "cart", "--commands", images / "safety_cart.png")


if __name__ == "__main__":
    main()
