"""Pages in the browser that this machine serves."""

from __future__ import annotations

import contextlib
import io
import socket

import viser

from pipeline.records.errors import UserError


def check_host(host: str) -> None:
    """Check that something can be served, before long work.

    Raises:
        UserError: nothing can be served there.
    """
    try:
        with socket.socket() as probe:
            probe.bind((host, 0))
    except OSError as error:
        raise UserError(f"nothing can be served on --host {host} ({error.strerror}); leave it out.") from error


def start_server(host: str, port: int, label: str) -> viser.ViserServer:
    """Begin to serve on the first free port from ``port`` on, without the server's own notice."""
    with contextlib.redirect_stdout(io.StringIO()):
        return viser.ViserServer(host=host, port=port, label=label, verbose=False)
