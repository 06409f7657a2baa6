"""A dry run reaches no vehicle: what it imports and which sockets it opens."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from tests.gcs.clips import write_clip


def test_it_builds_no_wire_and_opens_no_socket_but_the_pages(tmp_path: Path) -> None:
    """In a process of its own: nothing that could reach a vehicle is even imported, with the page neither."""
    clip = write_clip(tmp_path / "a.mp4")
    program = f"""
import os, signal, socket, sys, threading, urllib.request
real = socket.socket
class Refused(socket.socket):
    def __init__(self, *args, **kwargs):
        raise AssertionError("a dry run opened a socket")
socket.socket = Refused
from pathlib import Path
from gcs.cli.dryrun import main
from gcs.dryrun.batch import Options, run
from gcs.config import Config
from tests.gcs.colour_tracker import ColourTracker
from tracker.box import Box
run(Options({str(clip)!r}, Path({str(tmp_path / "out")!r}), Config(), box=Box(76, 106, 32, 32)),
    tracker_factory=lambda choice: ColourTracker())
socket.socket = real
from dataclasses import replace
from gcs.dryrun import page as dryrun_page
from gcs.operator.config import PageConfig
opened, said, visits = [], [], []
sys.addaudithook(lambda event, args: event in ("socket.bind", "socket.connect") and opened.append(event))
def visit(text):
    said.append(text)
    if text.startswith("page: "):
        browser = urllib.request.build_opener(urllib.request.HTTPCookieProcessor())
        visit.looking = threading.Thread(target=lambda: visits.append(browser.open(text.split()[1]).read()))
        visit.looking.start()
    if text.startswith("selected"):
        os.kill(os.getpid(), signal.SIGINT)
config = replace(Config(), page=PageConfig(port=0))
summary = dryrun_page.run(Options({str(clip)!r}, Path({str(tmp_path / "out")!r}), config, box=Box(76, 106, 32, 32)),
    visit, lambda choice: ColourTracker())
visit.looking.join()
assert summary is None, said  # nobody confirmed: it never played
assert b"<html" in visits[0]
assert opened.count("socket.bind") == 1, opened
assert opened.count("socket.connect") == 2, opened  # the visitor's, who is sent on once
forbidden = {{"gcs.wire", "gcs.transport", "gcs.codec", "gcs.telemetry", "gcs.autopilot",
    "gcs.app", "gcs.flight", "mavsdk", "pymavlink"}}
print(sorted(forbidden & set(sys.modules)))
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == "[]"
