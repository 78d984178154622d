"""Makes docs/static/pages.png anew: the pages of an identification and of a discovery, side by side.

python docs/picture.py      # some ten seconds; needs Chromium on the path
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from fmu_didim import discover, identify

ROOT = Path(__file__).resolve().parent.parent
PICTURE = ROOT / "docs/static/pages.png"
WIDTH, HEIGHT, BETWEEN = 1100, 1640, 16
"""[px] Of each page and of the stripe between both."""
SCALE = 0.62
"""[1] Of the picture, of that."""
FRAMES = """<!doctype html><style>body {{ margin: 0; background: #c8d2d8; display: flex; gap: {gap}px }}
iframe {{ border: 0; width: {width}px; height: {height}px; background: white }}</style>{frames}"""


def main() -> int:
    """Run both examples and photograph their pages."""
    browser = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    if browser is None:
        print("Chromium is not on the path: on Debian, apt install chromium", file=sys.stderr)
        return 1
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        identify(ROOT / "examples/scara/identify.yaml", folder / "left")
        discover(ROOT / "examples/arm2r/discover.yaml", folder / "right")
        pages = ("left/report.html", "right/discovery.html")
        frames = "".join(f'<iframe src="{page}" scrolling="no"></iframe>' for page in pages)
        both = folder / "both.html"
        both.write_text(FRAMES.format(gap=BETWEEN, width=WIDTH, height=HEIGHT, frames=frames), encoding="utf-8")
        subprocess.run(
            [
                browser, "--headless", "--no-sandbox", "--hide-scrollbars", f"--force-device-scale-factor={SCALE}",
                f"--window-size={2 * WIDTH + BETWEEN},{HEIGHT}", "--virtual-time-budget=5000",
                f"--screenshot={PICTURE}", both.as_uri(),
            ],
            check=True, capture_output=True,
        )  # fmt: skip
    return 0


if __name__ == "__main__":
    sys.exit(main())
