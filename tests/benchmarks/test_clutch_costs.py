"""`python -m benchmarks clutches`: every number of clutches is measured, in one run."""

from benchmarks.clutches import MOST_CLUTCHES, measure_clutch_costs, tabulate_costs


def test_each_number_of_clutches_has_its_cost() -> None:
    seen: list[float] = []
    targets, document = measure_clutch_costs(0.3, lambda done, total: seen.append(done / total))
    rows = document["clutches"]
    assert [row["clutches"] for row in rows] == list(range(1, MOST_CLUTCHES + 1))
    assert all(0.0 < row["p50_us"] <= row["p99_us"] for row in rows)
    assert rows[-1]["p50_us"] > 2.0 * rows[0]["p50_us"]  # eight cost more than twice one, whatever the machine does
    assert targets[0].value == rows[-1]["p50_us"] / MOST_CLUTCHES / rows[0]["p50_us"]
    assert len(tabulate_costs(document)) == MOST_CLUTCHES + 1
    assert seen[0] == 0.0
