"""Worker processes and a cluster: same bits, nothing left behind, one clear line when they are not there."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
from concurrent.futures import Future

import pytest

from rig.ensembles import WorkersAbsent, cluster, worker_processes
from sim_twin.ensembles.figures import Figures
from sim_twin.ensembles.population import Population
from sim_twin.ensembles.simulate import Outcome, simulate
from sim_twin.rigs.impact_beam.model import SineDrive, nominal
from sim_twin.rigs.impact_beam.rig import nominal_sensors
from sim_twin.rigs.rig_model import RunFigures
from sim_twin.twin import Twin

BEAM = Twin(nominal(), SineDrive(9.0, 20.0), nominal_sensors(nominal()))
VARIANTS = Population(BEAM, (("clearance", {}),)).variants(40, 5)  # three pieces of work
FIGURES = Figures(0.01, 0.05)


def bits(outcome: Outcome[RunFigures]) -> tuple[object, ...]:
    assert outcome.value is not None
    return outcome.value.values, {name: each.tobytes() for name, each in outcome.value.series.items()}


def environment() -> dict[str, str]:
    return {name: value for name, value in os.environ.items() if name.endswith("_NUM_THREADS")}


def test_two_workers_give_the_same_bits_as_this_thread() -> None:
    figures = [bits(outcome) for outcome in simulate(VARIANTS, FIGURES)]
    with worker_processes(2) as workers:
        spread = simulate(VARIANTS, FIGURES, workers.executor, in_flight=2)
        assert [bits(outcome) for outcome in spread] == figures


def test_a_worker_has_one_thread_and_is_out_of_the_terminal_s_reach() -> None:
    before = environment()
    with worker_processes(1) as workers:
        assert set(workers.executor.submit(environment).result().values()) == {"1"}
        blocked = workers.executor.submit(signal.pthread_sigmask, signal.SIG_BLOCK, ()).result()
        assert {signal.SIGINT, signal.SIGHUP, signal.SIGQUIT} <= blocked
    assert environment() == before
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, ())


def _interrupt(_: Future[None]) -> None:
    raise KeyboardInterrupt


def test_workers_are_gone_at_once_when_whoever_uses_them_stops() -> None:
    before = set(multiprocessing.active_children())  # an emulator of another test may be among them
    with pytest.raises(KeyboardInterrupt, match=r"^$"), worker_processes(1) as workers:
        _interrupt(workers.executor.submit(signal.pause))  # would never end
    assert set(multiprocessing.active_children()) <= before


def test_the_death_of_a_worker_is_told() -> None:
    with pytest.raises(WorkersAbsent, match="a worker process died"), worker_processes(1) as workers:
        workers.executor.submit(os.kill, workers.executor.submit(os.getpid).result(), signal.SIGKILL).result()


def test_a_cluster_needs_a_package_and_an_address(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(WorkersAbsent, match=r"nowhere is no address of a scheduler, such as tcp://"):
        cluster("nowhere").__enter__()
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(WorkersAbsent, match=r"pip install 'rattle\[cluster\]'"):
        cluster("tcp://127.0.0.1:8786").__enter__()
