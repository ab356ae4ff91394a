"""Make docs/report.png and docs/report_390.png: the first screen of a report, wide and narrow.

Usage: python docs/picture.py REPORT.html [CHROMIUM]
"""

import sys
from io import BytesIO
from pathlib import Path

from PIL import Image
from playwright.sync_api import sync_playwright

# name of each picture, and width and height of its screen, pixels
SCREENS = {"report": (1440, 900), "report_390": (390, 844)}
COLOURS = 48


def main(report, browser="/usr/bin/chromium"):
    """Write the pictures of the page at the path `report` beside this file."""
    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=browser, args=["--no-sandbox"])
        for name, (width, height) in SCREENS.items():
            page = chromium.new_page(viewport={"width": width, "height": height})
            page.goto(Path(report).resolve().as_uri())
            picture = Image.open(BytesIO(page.screenshot())).convert("RGB")
            # few colours, so that the file is small
            few = {"method": Image.Quantize.MAXCOVERAGE, "dither": Image.Dither.NONE}
            picture = picture.quantize(COLOURS, **few)
            picture.save(Path(__file__).with_name(f"{name}.png"), optimize=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
