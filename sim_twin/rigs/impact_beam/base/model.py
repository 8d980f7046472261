"""Parameters of the flexible base, with the source's Table 1 and else assumed values as defaults."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

from daq.quantity import Bound, Flat, Quantity, Source, Whole
from sim_twin.parts.frame import Bar
from sim_twin.parts.plate import Sheet
from sim_twin.ranges import require, require_bounds

_ALUMINIUM = 70e9, 2700.0  # Pa, kg/m3
_PLATE = Sheet(*_ALUMINIUM, nu=0.33, thickness=0.0127)
_POST = Bar(*_ALUMINIUM, width=0.0381, depth=0.0254)
_YOKE_BAR = Bar(*_ALUMINIUM, width=0.01905, depth=0.0127)
_TABLE_1 = Source("Deck and Dubowsky, table 1")
_WITHIN_PLATE = ("post_x", "yoke_x", "shaker_x", "accelerometer_x")


@dataclass(frozen=True, slots=True)
class Yoke:
    """Frame around the beam's end, across the beam: foot bar, two legs, bridge with both force sensors.

    `bar` has its width along the beam. `span` between the legs and `foot_height` (m) of the foot bar above
    the plate's mid-plane; `sensor_mass` (kg) in the bridge's middle; `head_stiffness` (N/m) of the impedance
    head between plate and foot bar. All assumed.
    """

    bar: Annotated[Bar, Flat("bar_")] = _YOKE_BAR
    span: Annotated[float, Quantity("mm", 1, 1000), Bound("m", 0.0, above=True)] = 0.0635
    foot_height: Annotated[float, Quantity("mm", 0.1, 500), Bound("m", 0.0, above=True)] = 0.020
    sensor_mass: Annotated[float, Quantity("kg", 0, 10), Bound("kg", 0.0)] = 0.10
    head_stiffness: Annotated[float, Quantity("N/m", 1e4, 1e12), Bound("N/m", 0.0, above=True)] = 1e8

    def __post_init__(self) -> None:
        require_bounds("Yoke", self)


@dataclass(frozen=True, slots=True)
class Shaker:
    """Shaker on the plate: `body_mass` kg, `height`, `diameter` m; its connecting rod, steel. All assumed.

    `share` of the coil's reaction (and of its suspension's) that the plate takes: 1 for a shaker on the
    plate, 0 for one on its own ground.
    """

    body_mass: Annotated[float, Quantity("kg", 0, 100, key="mass"), Bound("kg", 0.0)] = 1.1
    height: Annotated[float, Quantity("mm", 1, 1000), Bound("m", 0.0, above=True)] = 0.075
    diameter: Annotated[float, Quantity("mm", 1, 1000), Bound("m", 0.0, above=True)] = 0.076
    share: Annotated[float, Quantity("", 0, 1), Bound("", 0.0, 1.0)] = 1.0
    rod_length: Annotated[float, Quantity("mm", 1, 1000), Bound("m", 0.0, above=True)] = 0.050
    rod_diameter: Annotated[float, Quantity("mm", 0.1, 100), Bound("m", 0.0, above=True)] = 0.002
    rod_modulus: Annotated[float, Quantity("GPa", 0.01, 1000), Bound("Pa", 0.0, above=True)] = 207e9
    rod_density: Annotated[float, Quantity("kg/m^3", 10, 25_000), Bound("kg/m3", 0.0, above=True)] = 7800.0

    def __post_init__(self) -> None:
        require_bounds("Shaker", self)


@dataclass(frozen=True, slots=True)
class Cover:
    """Box over the plate: outer `length` (x), `width` (y), `height` in m (Table 1), walls of one `sheet`.

    `frame_mass` kg/m on all twelve edges. The walls are stiff in their own planes and joined so that
    neighbours turn together along their edge. `fixing_stiffness` (N/m) holds it to the plate at the middle of
    each of its edges. Its lowest `modes` are kept. Sheet, frame and fixing are assumed.
    """

    sheet: Annotated[Sheet, Flat("sheet_")]
    frame_mass: Annotated[float, Quantity("kg/m", 0, 50), Bound("kg/m", 0.0)]
    length: Annotated[float, Quantity("mm", 10, 5000), _TABLE_1, Bound("m", 0.0, above=True)] = 0.401
    width: Annotated[float, Quantity("mm", 10, 5000), _TABLE_1, Bound("m", 0.0, above=True)] = 0.320
    height: Annotated[float, Quantity("mm", 10, 5000), _TABLE_1, Bound("m", 0.0, above=True)] = 0.259
    fixing_stiffness: Annotated[float, Quantity("N/m", 1e2, 1e12), Bound("N/m", 0.0, above=True)] = 1e7
    modes: Annotated[int, Whole(1, 60)] = 14

    def __post_init__(self) -> None:
        require_bounds("Cover", self)


COVERS = {
    "none": None,
    "aluminium": Cover(Sheet(*_ALUMINIUM, nu=0.33, thickness=0.0016), frame_mass=0.3),
    "fibreglass": Cover(Sheet(15e9, 1800.0, 0.2, 0.003), frame_mass=0.0),
}


@dataclass(frozen=True, slots=True)
class FlexibleBase:
    """Plate, post, yoke, shaker and cover, in SI.

    The plate (`sheet`, `length` x, `width` y: Table 1) is clamped on square patches of side `clamp` in its
    corners. Everything stands on its centre line, at `post_x` (pivot), `yoke_x` (beam's end), `shaker_x`,
    with the beam at `beam_height` above the mid-plane. `damping_ratio` holds for every mode of the base.
    Beside its static shapes the base keeps the `modes` own modes that matter most at the yoke. `elements`
    along the plate's length.
    """

    sheet: Annotated[Sheet, Flat("plate_", source="Deck and Dubowsky, table 1 (thickness); else assumed")] = (
        _PLATE
    )
    length: Annotated[float, Quantity("mm", 10, 5000), _TABLE_1, Bound("m", 0.0, above=True)] = 0.390
    width: Annotated[float, Quantity("mm", 10, 5000), _TABLE_1, Bound("m", 0.0, above=True)] = 0.305
    clamp: Annotated[float, Quantity("mm", 1, 1000)] = 0.0254
    damping_ratio: Annotated[float, Quantity("", 0, 0.5, key="damping"), Bound("", 0.0, 1.0)] = 0.02
    post: Annotated[Bar, Flat("post_")] = _POST
    post_x: Annotated[float, Quantity("mm", 0, 5000)] = 0.055
    yoke_x: Annotated[float, Quantity("mm", 0, 5000)] = 0.335
    shaker_x: Annotated[float, Quantity("mm", 0, 5000)] = 0.248
    beam_height: Annotated[float, Quantity("mm", 1, 1000)] = 0.130
    yoke: Annotated[Yoke, Flat("yoke_")] = Yoke()
    shaker: Annotated[Shaker, Flat("shaker_")] = Shaker()
    accelerometer_x: Annotated[float, Quantity("mm", 0, 5000)] = 0.195
    accelerometer_y: Annotated[float, Quantity("mm", 0, 5000)] = 0.2025
    cover: Annotated[Cover | None, Flat("cover_")] = None
    modes: Annotated[int, Whole(0, 60)] = 10
    elements: Annotated[int, Whole(4, 40), Bound("", 4)] = 14

    def __post_init__(self) -> None:
        require_bounds("FlexibleBase", self)
        require("FlexibleBase", "clamp", self.clamp, 0.0, min(self.length, self.width) / 2, "m", above=True)
        for name in _WITHIN_PLATE:
            require("FlexibleBase", name, getattr(self, name), 0.0, self.length, "m")
        require("FlexibleBase", "accelerometer_y", self.accelerometer_y, 0.0, self.width, "m")
        require("FlexibleBase", "beam_height", self.beam_height, self.yoke.foot_height, unit="m", above=True)


def flexible_base(cover: str = "none", **changes: Any) -> FlexibleBase:
    """Return the base with a `cover` ("none", "aluminium", "fibreglass") and `changes` of its other fields.

    Raises KeyError for another cover, TypeError for another field.
    """
    return FlexibleBase(**{"cover": COVERS[cover], **changes})
