"""Take part in a running simulation from Python, as the live page does: `navstack live` shows it in the browser."""

import time

from navstack.live import Session
from navstack.shortcuts import make_scenario

session = Session(make_scenario("office", goals=["kitchen"]), speed=None)
while session.time < 5.0:
    session.advance(0.05, budget_s=0.05, timer=time.perf_counter)
session.interact({"kind": "goal", "pose": [6.2, 12.0, 1.57]})
while not session.is_done:
    session.advance(0.05, budget_s=0.05, timer=time.perf_counter)
print(f"{session.time:.1f} s simulated")
print(f"{len(session.current_scenario().interactions)} interaction: the scenario gives the same run again")
