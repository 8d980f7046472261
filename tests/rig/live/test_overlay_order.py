from rig.live.scene import OverlayOrder


def test_measured_data_waits_for_its_prediction() -> None:
    order = OverlayOrder[str](["measured", "predicted"], patience_s=2.0)
    order.note("measured", 1.0)
    order.add(1.0, "measured 1")
    assert order.ready() == []
    order.note("predicted", 0.5)
    order.add(0.5, "predicted 0.5")
    assert order.ready() == ["predicted 0.5"]
    order.note("predicted", 1.0)
    assert order.ready() == ["measured 1"]


def test_patience_ends() -> None:
    order = OverlayOrder[str](["measured", "predicted"], patience_s=2.0)
    for time_s in (1.0, 2.0, 3.5):
        order.note("measured", time_s)
        order.add(time_s, f"at {time_s}")
    assert order.ready() == ["at 1.0"]


def test_without_a_prediction_nothing_waits() -> None:
    order = OverlayOrder[str](["measured"], patience_s=2.0)
    order.note("measured", 1.0)
    order.add(1.0, "measured 1")
    assert order.ready() == ["measured 1"]


def test_what_is_left_comes_in_order_of_time() -> None:
    order = OverlayOrder[str](["measured"], patience_s=2.0)
    for time_s in (3.0, 1.0, 2.0, 1.0):
        order.add(time_s, f"{time_s}")
    assert order.rest() == ["1.0", "1.0", "2.0", "3.0"]
    assert order.rest() == []


def test_items_come_in_lots() -> None:
    order = OverlayOrder[str](["measured"], patience_s=0.0, step_s=0.25)
    lots = []
    for tenth in range(1, 8):
        order.note("measured", tenth / 10)
        order.add(tenth / 10, str(tenth))
        lots.append(order.ready())
    assert lots == [["1"], [], [], ["2", "3", "4"], [], [], ["5", "6", "7"]]
