"""How fast a page of the report opens in headless Chromium: time and processor time, file by file.

    python benchmarks/report_opening.py reports/index.html other/index.html

Every page is opened ``--times`` times in a fresh browser without a network; medians are printed. Times are the
browser's own (navigation timing), in seconds: first contentful paint, load event, and how long the page takes to answer
a click on the first cell of its first heat map (0 where cells lead nowhere). CPU is that of the page's main thread.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path
from statistics import median

sys.path.insert(0, str(Path(__file__).parents[1]))
from tests.browser import open_tab  # noqa: E402

MOMENTS = """(() => {
  const entry = performance.getEntriesByType("navigation")[0];
  const paint = performance.getEntriesByName("first-contentful-paint")[0];
  return [paint ? paint.startTime : NaN, entry.domInteractive, entry.loadEventEnd];
})()"""
CELL = "table.heat a"


def opened(page_file: Path, width: int, height: int) -> dict[str, float]:
    """Open a page once and return its figures in seconds."""
    with open_tab(width, height) as page:
        page.call("Page.navigate", url=page_file.resolve().as_uri())
        page.wait("location.protocol == 'file:' && performance.getEntriesByType('navigation')[0].loadEventEnd > 0")
        page.wait("performance.getEntriesByName('first-contentful-paint').length > 0")
        paint, interactive, loaded = (value / 1000 for value in page.evaluate(MOMENTS))
        time.sleep(1.0)  # work that the page leaves for later counts too
        figures = {"first paint": paint, "interactive": interactive, "loaded": loaded}
        figures["CPU of opening"] = page.processor_seconds()
        figures["trials of a cell"] = 0.0
        if page.evaluate(f"Boolean(document.querySelector('{CELL}'))"):
            before = time.perf_counter()
            page.evaluate(f"document.querySelector('{CELL}').click()")
            page.wait("location.hash && document.activeElement.matches('summary')")  # filled, and gone to
            figures["trials of a cell"] = time.perf_counter() - before
        before_scene = page.processor_seconds()
        begin = time.perf_counter()
        page.evaluate("document.querySelector('.view').scrollIntoView({block: 'center', behavior: 'instant'})")
        page.wait("document.querySelector('.view canvas')")
        figures["first 3D view"] = time.perf_counter() - begin
        time.sleep(1.0)
        figures["CPU of 3D"] = page.processor_seconds() - before_scene
        if page.console_errors or page.failed_requests:
            print(f"{page_file}: {page.console_errors} {page.failed_requests}", file=sys.stderr)
    return figures


def main() -> int:
    """Parse the command line, open the pages, print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("pages", nargs="+", type=Path)
    parser.add_argument("--times", type=int, default=3)
    parser.add_argument("--size", default="1280x900", help="of the window")
    arguments = parser.parse_args()
    width, height = map(int, arguments.size.split("x"))
    for page_file in arguments.pages:
        runs = [opened(page_file, width, height) for _ in range(arguments.times)]
        print(f"{page_file}: {page_file.stat().st_size / 1e6:.1f} MB, {arguments.times} times")
        for name in runs[0]:
            print(f"  {name:18s} {median(run[name] for run in runs):7.2f} s")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
