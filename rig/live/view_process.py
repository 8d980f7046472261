"""The process that talks to Rerun: reads frames from standard input until it ends.

Rerun blocks its caller while the viewer's server stalls, and drops without a word once it is gone: so all of
it happens here, where nobody waits. Run as `python -m rig.live.view_process LAYOUT_JSON PATIENCE MEMORY`.
"""

from __future__ import annotations

import json
import os
import select
import sys
import threading
import time

import rerun as rr

from daq.errors import InstrumentAbsent
from rig.live.blueprint import blueprint
from rig.live.frames import read_frames
from rig.live.layout import Layout
from rig.live.scene import Scene
from rig.live.viewer_server import ViewerServer

_LAST_WORDS_S = 1.5
"""What is still in the pipe when the run ends has this long to reach the viewer."""

_APPLICATION = "rattle"


def main() -> None:
    """Serve one view until standard input ends."""
    layout, patience_s, memory_limit = Layout.from_json(sys.argv[1]), float(sys.argv[2]), sys.argv[3]
    try:
        with ViewerServer(memory_limit, sys.stderr.buffer) as server:
            threading.Thread(target=_leave_with_parent, args=[os.getppid(), server], daemon=True).start()
            _announce({"url": server.page_url, "sink": server.sink_url, "server": server.pid})
            _serve(server, layout, patience_s)
    except InstrumentAbsent as error:
        _announce({"error": str(error)})


def _serve(server: ViewerServer, layout: Layout, patience_s: float) -> None:
    recording = rr.RecordingStream(_APPLICATION)
    recording.connect_grpc(server.sink_url, default_blueprint=blueprint(layout))
    recording.send_recording_name(layout.title)
    scene = Scene(recording, layout, patience_s)
    scene.open()
    for frame in read_frames(sys.stdin.buffer):
        scene.take(frame)
    scene.finish()
    recording.flush(timeout_sec=_LAST_WORDS_S)


def _announce(message: dict[str, str | int]) -> None:
    print(json.dumps(message), flush=True)


def _leave_with_parent(parent: int, server: ViewerServer) -> None:
    """End this process some time after the pipe's other end has closed, even if Rerun blocks."""
    pipe = select.poll()
    pipe.register(sys.stdin.fileno(), 0)
    while os.getppid() == parent and not pipe.poll(500):
        pass
    time.sleep(_LAST_WORDS_S)
    server.close()
    os._exit(1)


if __name__ == "__main__":
    main()
