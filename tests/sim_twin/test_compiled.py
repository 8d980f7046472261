"""The cache of compiled kernels: stamped by every source that a kernel is built from."""

from __future__ import annotations

import pickle
from copy import copy
from pathlib import Path

import pytest

import sim_twin.compiled as compiled_module
from sim_twin.switched import kernel


def stamp() -> str:
    compiled_module._digest_of.cache_clear()
    return compiled_module._digest_of("sim_twin.switched.kernel")


def test_a_change_in_a_source_below_the_kernel_changes_its_stamp(monkeypatch) -> None:
    before, read = stamp(), compiled_module._source_of
    changed = {"sim_twin.compiled": "\n# another option\n"}
    monkeypatch.setattr(compiled_module, "_source_of", lambda name: read(name) + changed.get(name, ""))
    assert stamp() != before


def test_a_change_in_a_source_beside_it_does_not(monkeypatch) -> None:
    before, read = stamp(), compiled_module._source_of
    changed = {"sim_twin.sensors": "\n# another filter\n"}
    monkeypatch.setattr(compiled_module, "_source_of", lambda name: read(name) + changed.get(name, ""))
    assert stamp() == before


def test_the_kernels_are_stamped_so() -> None:
    locator = kernel._run._cache._impl.locator  # numba keeps it there
    assert locator.get_source_stamp() == stamp()


def test_what_other_sources_were_compiled_to_is_not_even_read(tmp_path: Path) -> None:
    """Not a class that they had and these have not."""
    file = copy(kernel._run._cache._cache_file)  # numba keeps it there
    file._index_path = str(tmp_path / "index")
    names_a_class_that_is_gone = b"csim_twin.compiled\nGone\n."
    Path(file._index_path).write_bytes(pickle.dumps("of other sources") + names_a_class_that_is_gone)
    assert file._load_index() == {}
    file._save_index({"a key": "of these sources"})
    assert file._load_index() == {"a key": "of these sources"}
    Path(file._index_path).write_bytes(pickle.dumps(file._version) + names_a_class_that_is_gone)
    with pytest.raises(AttributeError, match="Gone"):  # of these sources it would be
        file._load_index()
