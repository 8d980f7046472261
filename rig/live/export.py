"""A finished run as a Rerun recording, with the views of the live run."""

from __future__ import annotations

from pathlib import Path

import rerun as rr

from daq.log.reader import LogReader
from rig.live.blueprint import blueprint
from rig.live.layout import layout_of
from rig.live.picture import Picture
from rig.live.scene import Scene

_SPECTRUM_PERIOD_S = 2.0


def rrd_from_log(log: Path, rrd: Path, picture: Picture | None = None) -> None:
    """Write what the live view of the run in `log` showed to `rrd`, all of it; raises LogError."""
    with LogReader(log) as reader:
        measured, predicted, nominal = (
            list(reader.channels(origin).values()) for origin in ("measured", "predicted", "nominal")
        )
        derived = list(reader.channels("derived").values())
        layout = layout_of(log.stem, measured, predicted, picture, nominal=nominal, derived=derived)
        recording = rr.RecordingStream("rattle", send_properties=False)
        recording.set_sinks(rr.FileSink(rrd), default_blueprint=blueprint(layout))
        scene = Scene(recording, layout, _SPECTRUM_PERIOD_S)
        scene.open()
        scene.show_dropped(0)
        for origin, block in reader.blocks(("measured", "nominal", "predicted")):
            scene.add_block(origin, block)
        for _, block in reader.blocks("derived"):
            scene.add_derived(block)
        for impact in reader.impacts():
            scene.add_impact(impact)
        for event in reader.events():
            scene.add_event(event)
        scene.finish()
        recording.flush()
        recording.disconnect()
