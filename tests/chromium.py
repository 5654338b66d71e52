"""Open a report in headless Chromium and say what happened."""

from __future__ import annotations

import html
import json
import os
import re
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import Any

import pytest

RECORDER = """<script>
window.seen = {errors: [], drawn: 0, requests: [], frames: 0};
window.addEventListener("error", function (e) { seen.errors.push(String(e.message || e.target.src)); }, true);
window.addEventListener("unhandledrejection", function (e) { seen.errors.push(String(e.reason)); });
</script>"""

# The picture that plotly.js itself gives of its WebGL scene, without legend: pixels of strong colour are content.
EXAMINER = """<script>
function finish() {
  seen.requests = performance.getEntriesByType("resource").map(function (r) { return r.name; })
    .filter(function (name) { return !/^(data|blob):/.test(name); });
  var out = document.createElement("pre");
  out.id = "seen"; out.textContent = JSON.stringify(seen);
  document.body.replaceChildren(out);
}
window.addEventListener("load", function () { setTimeout(function () {
  var place = document.getElementById("scene");
  Promise.resolve().then(function () {
    seen.frames = place._transitionData._frames.length;
    return Plotly.relayout(place, {showlegend: false, sliders: [], updatemenus: []});
  }).then(function () { return Plotly.toImage(place, {format: "png", width: 640, height: 420}); })
  .then(function (url) { return new Promise(function (done) {
    var image = new Image();
    image.onload = function () {
      var canvas = document.createElement("canvas");
      canvas.width = image.width; canvas.height = image.height;
      var context = canvas.getContext("2d");
      context.drawImage(image, 0, 0);
      var p = context.getImageData(0, 0, canvas.width, canvas.height).data;
      for (var k = 0; k < p.length; k += 4) {
        var strongest = Math.max(p[k], p[k + 1], p[k + 2]), weakest = Math.min(p[k], p[k + 1], p[k + 2]);
        if (p[k + 3] > 128 && strongest - weakest > 60) seen.drawn++;
      }
      done();
    };
    image.src = url;
  }); }).catch(function (e) { seen.errors.push(String(e)); }).then(finish);
}, 500); });
</script>"""

FLAGS = (
    "--headless", "--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
    "--disable-quic", "--no-first-run", "--disable-background-networking", "--disable-component-update",
    "--disable-sync", "--hide-scrollbars", "--window-size=900,700", "--virtual-time-budget=20000",
    "--host-resolver-rules=MAP * ~NOTFOUND",
)  # fmt: skip


def browser() -> str:
    """Path of a Chromium; without one the test is skipped, but fails in continuous integration."""
    for name in ("chromium", "chromium-browser", "google-chrome"):
        found = shutil.which(name)
        if found:
            return found
    reason = "no chromium, chromium-browser or google-chrome on the path"
    if os.environ.get("CI") == "true":
        pytest.fail(reason)
    pytest.skip(reason)


def open_page(page: str) -> dict[str, Any]:
    """What a page does in a browser that has no network.

    Returns
    -------
    dict
        ``errors``: script errors; ``drawn``: coloured pixels of the 3D view; ``frames``: frames it can play;
        ``requests``: what was loaded other than from the page itself.
    """
    program = browser()
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        file = Path(folder) / "report.html"
        page = page.replace("<head>", "<head>" + RECORDER, 1)
        before, after = page.rsplit("</body>", 1)
        file.write_text(f"{before}{EXAMINER}</body>{after}", encoding="utf-8")
        done = subprocess.run(
            [program, *FLAGS, f"--user-data-dir={folder}/profile", "--dump-dom", file.as_uri()],
            capture_output=True, text=True, timeout=120,
        )  # fmt: skip
    match = re.search(r'<pre id="seen">(.*?)</pre>', done.stdout, re.DOTALL)
    assert match, f"the browser gave no answer: {done.stderr[-500:]}"
    return json.loads(html.unescape(match[1]))
