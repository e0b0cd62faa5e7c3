"""After the warm-up, all kernels are loaded: the wall time of a run excludes compilation."""

from __future__ import annotations

import subprocess
import sys

SCRIPT = """
import navstack as nav
from numba.core.dispatcher import Dispatcher
from navstack.scenario import Scenario, run_scenario, warm_up

loaded = []
compile = Dispatcher.compile

def noted(self, signature):
    loaded.append(self.py_func.__name__)
    return compile(self, signature)

Dispatcher.compile = noted
here = nav.load_places("office")
scenario = Scenario(nav.load_map(nav.map_path("office")), nav.load_configuration(["turtlebot"]), here.start, here.goals[:1])
warm_up(scenario)
assert len(loaded) > 20, loaded
loaded.clear()
assert run_scenario(scenario).goals[0].succeeded
print(loaded)
"""


def test_no_kernel_is_loaded_after_the_warm_up() -> None:
    # a process of its own: in this one other tests have loaded them
    ended = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, text=True, timeout=300, check=False)
    assert ended.returncode == 0, ended.stderr
    assert ended.stdout == "[]\n"
