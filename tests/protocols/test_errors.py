"""A refusal is one short sentence, whatever the input was."""

import pytest

from protocols.errors import InputError, suggest_closest, tell_reason


def test_an_ordinary_sentence_is_as_it_was() -> None:
    text = f"file /{'a' * 255}/{'b' * 255}.toml: 5 \u00b5m is above 3 \u00b5m"
    assert str(InputError(text)) == text


@pytest.mark.parametrize(
    ("control", "shown"),
    [("\n", "\\n"), ("\x1b[2J", "\\x1b[2J"), ("\r", "\\r"), ("\u2028", "\\u2028"), ("\x9b", "\\x9b")],
)
def test_control_characters_are_written_out(control: str, shown: str) -> None:
    assert str(InputError(f"a{control}b")) == f"a{shown}b"


def test_a_word_that_is_no_path_is_shown_in_part() -> None:
    assert str(InputError(f"name {'x' * 70_000} is unknown")) == f"name {'x' * 60}... (70000 characters) is unknown"


def test_a_long_message_keeps_its_beginning_and_its_end() -> None:
    text = str(InputError(f"value {'a b ' * 9_000}; allowed is 1 to 2"))
    assert len(text) < 1000
    assert text.startswith("value a b a b")
    assert text.endswith("; allowed is 1 to 2")


def test_a_hint_is_a_name_that_is_like_it() -> None:
    names = ["lock", "drift", "hold_and_release"]
    assert suggest_closest("nosuch", names) == "known are lock, drift, hold_and_release"
    assert suggest_closest("dritf", names) == "did you mean drift?"
    assert suggest_closest("h", names) == "did you mean hold_and_release?"


def test_a_hint_lists_the_first_of_many_names() -> None:
    hint = suggest_closest("zzz", [f"name_{k}" for k in range(100)])
    assert hint.endswith("name_29 and 70 more")
    assert suggest_closest("zzz", ["a", "b"]) == "known are a, b"


def test_what_a_library_did_not_find_is_told_as_such() -> None:
    assert tell_reason(KeyError(0)) == "it has no entry 0"
    assert tell_reason(ValueError("two\nlines")) == "two lines"
    assert tell_reason(ValueError()) == "ValueError"
