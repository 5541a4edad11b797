"""Rates that are asked for again, on a clock by hand."""

from service.autopilot.rates import CHECK_NS, RateKeeper

ATTITUDE, TICK_NS, PERIOD_NS = 30, 100_000_000, 20_000_000


def started() -> RateKeeper:
    rates = RateKeeper({ATTITUDE: 50.0})
    rates.start(0)
    assert rates.due(0) == (ATTITUDE, 20_000)
    rates.acknowledge(accepted=True, denied=False)
    return rates


def fly(rates: RateKeeper, start_ns: int, span_ns: int, period_ns: int) -> list[tuple[int, int]]:
    """What is asked for while the message comes every `period_ns`, asked every tick."""
    asked = []
    for now_ns in range(start_ns, start_ns + span_ns, TICK_NS):
        for _ in range(now_ns // period_ns, (now_ns + TICK_NS) // period_ns):
            rates.heard(ATTITUDE)
        request = rates.due(now_ns)
        asked += [] if request is None else [request]
    return asked


def test_a_rate_that_another_client_lowered_is_low_and_asked_for_again() -> None:
    rates = started()
    assert fly(rates, 0, 2 * CHECK_NS, PERIOD_NS) == [] and not rates.is_low(ATTITUDE)
    asked = fly(rates, 2 * CHECK_NS, CHECK_NS + TICK_NS, 50 * PERIOD_NS)
    assert rates.is_low(ATTITUDE) and asked == [(ATTITUDE, 20_000)]
    fly(rates, 3 * CHECK_NS + TICK_NS, CHECK_NS + TICK_NS, PERIOD_NS)
    assert not rates.is_low(ATTITUDE)


def test_silence_of_the_autopilot_says_nothing_of_its_rates() -> None:
    rates = started()
    fly(rates, 0, CHECK_NS + TICK_NS, PERIOD_NS)
    back_ns = 20 * CHECK_NS
    assert fly(rates, back_ns, 2 * CHECK_NS, PERIOD_NS) == []
    assert not rates.is_low(ATTITUDE)
