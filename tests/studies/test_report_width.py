"""tune's report fits the window of a telephone: nothing is cut off, and no column is squeezed to single letters."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from navstack.parameters import RewrittenFiles
from navstack.parameters.yaml_rewrite import ValueChange
from navstack.studies.report import ReportHeader, tuning_page
from tests.studies.test_pipeline import OneInfeasible, run_tune

BROWSER = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
WIDTH = 420
MEASURE = f"""<iframe id=page srcdoc="" style="width:{WIDTH}px;height:3000px;border:0"></iframe><pre id=out></pre><script>
const frame = document.getElementById("page");
frame.onload = () => {{
  const page = frame.contentDocument;
  const tables = [...page.querySelectorAll("table")].map(t => t.scrollWidth - t.clientWidth);
  const cells = [...page.querySelectorAll("td:first-child")].map(c => c.clientWidth);
  document.getElementById("out").textContent = JSON.stringify(
    {{page: page.documentElement.scrollWidth, table: Math.max(...tables), cell: Math.min(...cells)}});
}};
frame.srcdoc = CONTENT;
</script>"""


@pytest.mark.slow
@pytest.mark.skipif(BROWSER is None, reason="there is no browser on this machine")
def test_the_report_fits_420_pixels(tmp_path: Path) -> None:
    tuning = run_tune(tmp_path / "study", OneInfeasible(4), sim_time=0.6, trials=6)
    header = ReportHeader(
        "Tuning", "turtlebot", "navstack tune --param DWAPlannerROS/path_distance_bias=8:64", "Summary."
    )
    place = "turtlebot/dwa_local_planner_params.yaml:31"
    changes = (ValueChange("DWAPlannerROS/path_distance_bias", 64.0, 27.53, place, True),)
    html = "\n".join(tuning_page(tuning, header, RewrittenFiles({}, (), changes), {}, ()))
    page = tmp_path / "page.html"
    page.write_text(MEASURE.replace("CONTENT", json.dumps(html).replace("</", "<\\/")), "utf-8")
    assert BROWSER is not None
    options = ["--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={tmp_path / 'profile'}"]
    command = [BROWSER, *options, "--virtual-time-budget=5000", "--dump-dom", page.as_uri()]
    dom = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True).stdout
    found = re.search(r'<pre id="out">(.+?)</pre>', dom)
    assert found, dom[-2000:]
    measured = json.loads(found[1])
    assert measured["page"] <= WIDTH
    assert measured["table"] <= 0
    assert measured["cell"] >= 50
