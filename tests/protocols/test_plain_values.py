"""Plain values through a pipe: what arrives is what was sent, and nothing else than plain values is sent or read."""

import io

import numpy as np
import pytest

from protocols.files.plain_values import read_value, write_value

PLAIN = [None, True, 3, -2.5, float("inf"), "α\ud800\n", [], {}, {"a": [1, {"b": None}]}, {"array": 3}]


def through(value: object) -> object:
    pipe = io.BytesIO()
    write_value(value, pipe)
    pipe.seek(0)
    return read_value(pipe)


@pytest.mark.parametrize("value", PLAIN)
def test_a_plain_value_arrives(value: object) -> None:
    assert through(value) == value


def test_arrays_arrive_in_their_places() -> None:
    first, second = np.arange(6.0).reshape(2, 3), np.array([1, 2], dtype=np.uint8)
    sent = {
        "x": first.T, "none": np.zeros((0, 2)), "one": np.array(2.5), "array": np.array(["text"]),
        "deep": [second, (np.float64(1.5), np.int64(7))],
    }  # fmt: skip
    got = through(sent)
    assert isinstance(got, dict)
    np.testing.assert_array_equal(got["x"], first.T)
    assert got["none"].shape == (0, 2)
    assert (got["one"].shape, got["one"][()]) == ((), 2.5)
    np.testing.assert_array_equal(got["deep"][0], second)
    assert got["deep"][0].dtype == np.uint8
    assert got["deep"][1] == [1.5, 7]
    assert got["array"].tolist() == ["text"]


def test_a_dictionary_whose_only_name_is_array_is_itself() -> None:
    got = through({"array": np.arange(3)})
    assert isinstance(got, dict)
    np.testing.assert_array_equal(got["array"], np.arange(3))


@pytest.mark.parametrize("value", [object(), {1, 2}, b"bytes", np.array([object()], dtype=object), [len]])
def test_what_is_not_plain_is_not_sent(value: object) -> None:
    with pytest.raises((TypeError, ValueError)):
        through(value)


NOT_PLAIN = [
    b"x []\n", b"[[], {\n", b'[[], {"array": "0"}]\n', b'[[], {"array": "-1"}]\n', b"\x80\x04]\n", b"[]\n", b"{}\n", b"\n",
    b'[[["|O", [1]]], 0]\n12345678', b'[[["<f8", [-1]]], 0]\n', b'[[["<f8", [1000000, 1000000]]], 0]\n', b"[[1], 0]\n",
]  # fmt: skip


@pytest.mark.parametrize("text", NOT_PLAIN)
def test_what_is_not_plain_is_not_read(text: bytes) -> None:
    with pytest.raises(ValueError):  # noqa: PT011  # of json, numpy and ours
        read_value(io.BytesIO(text))


@pytest.mark.parametrize("text", [b"", b"[[], 1", b'[[["<f8", [2]]], 0]\n12345678'])
def test_the_end_is_told(text: bytes) -> None:
    with pytest.raises(EOFError):
        read_value(io.BytesIO(text))
