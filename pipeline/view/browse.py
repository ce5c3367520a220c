"""`./dev view`: everything that the pipeline made, to look at in a browser.

Without a name, the prepared objects are shown. A name leads to a row or to a table: `merge/cube/soup_can/3`,
`validate/pinch/cube`, or a trial as the report names it, `synthesized/cube/soup_can/3`. Ctrl-C ends it.
"""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from pipeline.records.parameters import read_parameters
from pipeline.stages.running import command

if TYPE_CHECKING:
    from collections.abc import Sequence


def command_line() -> argparse.ArgumentParser:
    """Return the options."""
    parser = argparse.ArgumentParser(
        prog="./dev view", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("name", nargs="?", default="", help="row or table to show first")
    parser.add_argument("--port", type=int, default=8080, help="the next free one from there (default: %(default)s)")
    parser.add_argument("--host", default="127.0.0.1", help="(default: %(default)s, this machine only)")
    return parser


@command("view")
def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command."""
    parser = command_line()
    chosen = parser.parse_args(arguments)
    if not 1 <= chosen.port <= 65535:
        parser.error("--port must be 1 to 65535")
    from pipeline.hand.model import load_hand
    from pipeline.view.library import Library
    from pipeline.view.page import Page

    def read_library() -> Library:
        parameters = read_parameters().with_assets()
        return Library(parameters, load_hand(parameters.hand))

    page = Page(read_library, chosen.host, chosen.port, chosen.name)
    print(f"{page.address} shows it (Ctrl-C ends it)", flush=True)
    page.run()
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
