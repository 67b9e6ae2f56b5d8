"""That the package is as fast as it claims, with room for slower machines."""

from __future__ import annotations

from throughput import COPIES, measure


def test_it_is_several_times_faster_than_numpy() -> None:
    rates = measure()
    report = "\n".join(f"{rate:12,.0f} steps/s  {name}" for name, rate in rates.items())
    print(report)
    assert rates["cpp_rl_gym, one environment"] >= 5 * rates["NumPy, one environment"], report
    assert rates[f"cpp_rl_gym, {COPIES} copies"] >= 2e6, report
