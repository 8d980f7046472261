"""All figures of the page, in its order; adding one means adding a line."""

from __future__ import annotations

from rig.reproduce.figure import Figure
from rig.reproduce.figures import ibs_7, ibs_8_9, ibs_10, ibs_11, ibs_base, psc, ssc_16, ssc_17

FIGURES: dict[str, Figure] = {
    figure.name: figure
    for figure in (
        ibs_7.FIGURE,
        ibs_8_9.FIGURE_8,
        ibs_8_9.FIGURE_9,
        ibs_10.FIGURE,
        ibs_11.FIGURE,
        ibs_base.FIGURE_12,
        ibs_base.FIGURE_13,
        ibs_base.TABLE_3,
        ssc_16.FIGURE,
        ssc_17.FIGURE,
        psc.FIGURE,
    )
}
