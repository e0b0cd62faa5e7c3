"""After the warm-up, all kernels are loaded, and `kernels.json` lists them: it is current."""

from __future__ import annotations

import subprocess
import sys

import pytest

SCRIPT = """
from navstack.parameters import load_configuration
import navstack as nav
from navstack.core import jit
from navstack.core.compilation import recorded_specializations
from navstack.core.kernel_cache import KernelDispatcher, describe
from navstack.scenario import Scenario, run_scenario, warm_up

loaded = []
compile = KernelDispatcher.compile

def noted(self, signature):
    loaded.append(self.py_func.__name__)
    return compile(self, signature)

KernelDispatcher.compile = noted
here = nav.load_places("office")
scenario = Scenario(nav.load_map(nav.map_path("office")), load_configuration(["turtlebot"]), here.start, here.goals[:1])
warm_up(scenario)
assert len(loaded) > 20, loaded
loaded.clear()
assert run_scenario(scenario).goals[0].succeeded
print(loaded)

used = set()
for kernel in jit.imported_kernels():
    for types, calls in kernel.dispatcher.calls.items():
        used |= {(kernel.name, describe(types)), *calls}
print(sorted(used - {(each.kernel.name, each.types) for each in recorded_specializations(scenario.configuration.planner_names)}))
"""


@pytest.mark.slow
def test_the_warm_up_loads_all_kernels_and_they_are_recorded() -> None:
    # a process of its own: in this one other tests have loaded them
    ended = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, text=True, timeout=300, check=False)
    assert ended.returncode == 0, ended.stderr
    loaded, unrecorded = ended.stdout.splitlines()
    assert loaded == "[]"
    assert unrecorded == "[]", "run tools/record_kernels.py"
