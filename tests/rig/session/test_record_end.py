"""A record that was complete when its run was stopped is told to be."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import cast

import pytest

from daq.errors import InterlockTripped
from daq.log.records import RECORD_END, Event
from rig.files.scenario import AcquisitionSection
from rig.session.run import Sequence
from rig.session.twin_feed import TwinFeed
from tests.rig.session.fakes import RATE
from tests.rig.session.test_guard import Bench, beats  # noqa: F401 - a fixture


@pytest.mark.parametrize("complete", [True, False])
def test_a_stop_at_the_end_of_a_record_leaves_it_complete(tmp_path: Path, complete: bool) -> None:
    bench, told = Bench(tmp_path, None), list[str]()

    def run() -> None:
        with bench.moving() as rig:
            rig.stream.append(lambda each: told.append(each.code) if isinstance(each, Event) else None)

            def stop() -> None:
                record = rig.acquisition.record_until is not None
                if record and rig.recorded == complete:
                    raise InterlockTripped("interlock: just then")

            rig.watch.checks.append(stop)
            wanted = AcquisitionSection(RATE, duration=0.5, settle=0.0)
            Sequence(wanted, rig, cast(TwinFeed, SimpleNamespace(feed_from=0))).drive_and_record()

    with pytest.raises(InterlockTripped, match="just then"):
        run()
    assert (RECORD_END in told) == complete
