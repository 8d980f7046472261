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
from functools import partial

import rerun as rr

from daq.errors import InstrumentAbsent
from daq.log.records import Impact
from rig.live.blueprint import blueprint
from rig.live.frames import BlockFrame, DroppedFrame, Frame, ShapeFrame, read_frames
from rig.live.layout import Layout
from rig.live.overlay_order import OverlayOrder
from rig.live.scene import Scene
from rig.live.viewer_server import ViewerServer

_LAST_WORDS_S = 1.5
"""What is still in the pipe when the run ends has this long to reach the viewer."""

_STEP_S = 0.3
"""Traces, beam and peaks go out together, in lots of this length: the viewer's axis ends at the newest of
them, and one that ran ahead would leave the others blank there."""

_APPLICATION = "rattle"


class Director:
    """Brings frames on stage in order of time, measured and predicted together."""

    def __init__(self, scene: Scene, layout: Layout, patience_s: float) -> None:
        self._scene = scene
        expected = [origin for origin, names in layout.origins.items() if names]
        self._order = OverlayOrder[partial[None]](expected or ["measured"], patience_s, _STEP_S)

    def take(self, frame: Frame) -> None:
        """Accept a frame and show what is due."""
        match frame:
            case BlockFrame("derived", block):
                begin_s = self._scene.time_of(block.time_ns)
                self._order.add(begin_s, partial(self._scene.add_derived, block))
            case BlockFrame(origin, block):
                self._scene.begin(block)
                end_s = block.end_sample / block.sample_rate
                self._order.note(origin, end_s)
                self._order.add(end_s, partial(self._scene.add_block, origin, block))
            case ShapeFrame():
                self._order.add(frame.time_s, partial(self._scene.add_shape, frame))
            case DroppedFrame(count):
                self._scene.show_dropped(count)
            case Impact():
                self._order.add(self._scene.time_of(frame.time_ns), partial(self._scene.add_impact, frame))
            case _:
                self._order.add(self._scene.time_of(frame.time_ns), partial(self._scene.add_event, frame))
        self._show(self._order.ready())

    def finish(self) -> None:
        """Show what still waits."""
        self._show(self._order.rest())
        self._scene.finish()

    def _show(self, due: list[partial[None]]) -> None:
        for show in due:
            show()
        if due:
            self._scene.flush()


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
    scene = Scene(recording, layout)
    scene.open()
    scene.show_dropped(0)
    director = Director(scene, layout, patience_s)
    for frame in read_frames(sys.stdin.buffer):
        director.take(frame)
    director.finish()
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
