from service.publish.pilot.fault_teller import SETTLED_NS, FaultTeller, fault_text


def test_a_fault_is_told_once_it_has_stood_and_so_is_its_end() -> None:
    teller = FaultTeller()
    assert teller.due(("link",), 0) is None
    assert teller.due(("link",), SETTLED_NS - 1) is None
    assert teller.due(("link",), SETTLED_NS) == b"distloc degraded: link"
    assert teller.due(("link",), 2 * SETTLED_NS) is None
    assert teller.due((), 3 * SETTLED_NS) is None
    assert teller.due((), 4 * SETTLED_NS) == b"distloc ok"
    assert teller.due((), 9 * SETTLED_NS) is None


def test_what_comes_and_goes_is_not_told() -> None:
    teller = FaultTeller()
    assert all(teller.due(("link",) if k % 2 else (), k * (SETTLED_NS - 1)) is None for k in range(20))


def test_a_text_fits_a_statustext() -> None:
    names = ("camera", "clock", "ekf", "heading", "link", "position", "rates")
    assert fault_text(names) == b"distloc degraded: camera, clock, ekf, heading, ..."
    assert len(fault_text(names)) == 50
