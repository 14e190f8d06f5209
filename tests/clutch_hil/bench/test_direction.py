"""Which way round a clutch slips, from slip and torque."""

import numpy as np
import pytest

from clutch_hil.bench.direction import MOVING_SLIP, SIGNED_TORQUE, find_directions, find_symmetric_reach

NAN = float("nan")


@pytest.mark.parametrize(
    ("slip", "torque", "way"),
    [
        ([5.0, -5.0], [1.0, 1.0], [1.0, -1.0]),
        ([0.0, 0.0], [8.0, -8.0], [1.0, -1.0]),  # plates stand: what they carry tells
        ([0.0, 0.5 * MOVING_SLIP], [-8.0, -8.0], [-1.0, -1.0]),  # a count of the encoder tells nothing
        ([-5.0, 0.0, 0.0, 5.0], [0.0, 0.0, 0.5 * SIGNED_TORQUE, 0.0], [-1.0, -1.0, -1.0, 1.0]),  # as it was before
        ([0.0, 0.0, -5.0], [0.0, 0.0, 0.0], [-1.0, -1.0, -1.0]),  # as it will be
        ([0.0, 0.0], [0.0, 0.0], [1.0, 1.0]),
        ([NAN, -5.0, NAN], [NAN, NAN, NAN], [-1.0, -1.0, -1.0]),
    ],
)
def test_the_way_round_is_that_of_the_slip(slip: list[float], torque: list[float], way: list[float]) -> None:
    assert find_directions(np.array(slip), np.array(torque)).tolist() == way


def test_piece_by_piece_it_is_what_it_is_in_one() -> None:
    slip = np.repeat([3.0, 0.0, -3.0, 0.0, 0.0, 3.0], 10)
    torque = np.repeat([3.0, 3.0, -3.0, 0.0, 2.0, 3.0], 10)
    whole, pieces, before = find_directions(slip, torque), [], None
    for begin in range(0, len(slip), 7):
        pieces.append(find_directions(slip[begin : begin + 7], torque[begin : begin + 7], before))
        before = pieces[-1][-1]
    assert np.array_equal(np.concatenate(pieces), whole)


def test_an_axis_reaches_both_ways_where_something_goes_backwards() -> None:
    forwards, backwards = np.array([0.0, 12.0, NAN, -0.5 * MOVING_SLIP]), np.array([-3.0, NAN])
    assert find_symmetric_reach(forwards) is None
    reach = find_symmetric_reach(forwards, backwards)
    assert reach is not None
    assert 12.0 < reach < 15.0
