import re

import numpy as np
import pytest

from daq.errors import UnphysicalParameter
from daq.signals.spectrum import Segmenting


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda: Segmenting(3), "segments: samples = 3: at least 4"),
        (lambda: Segmenting(8, overlap=1.0), "segments: overlap = 1: 0 to below 1"),
        (lambda: Segmenting(8, window=np.ones(7)), "segments: weights of the window = 7: 8, one a sample"),
    ],
)
def test_what_cannot_be_cut_is_refused(make, text: str) -> None:
    with pytest.raises(UnphysicalParameter, match=re.escape(text)):
        make()
