"""Numbers of ten thousand digits, in every text that is read: one short line, in words."""

import pytest

from resample.messages import LONGEST, naming, numbers_in, one_line
from resample.reading.texts import json_of, toml_of
from tests.fuzz.corpus import corpus
from tests.fuzz.files import put
from tests.fuzz.mutations import IS_NUMBER
from tests.fuzz.readers import READERS

HUGE = [b"1" * 10_000, b"-" + b"9" * 10_000, b"1." + b"1" * 10_000, b"1e" + b"9" * 5000]
TEXTS = [
    pytest.param(case, name, id=f"{case.reader}-{name}")
    for case in corpus()
    for name, content in case.files.items()
    if content[:64].isascii() and content[:64].decode().replace("\n", "").isprintable()
]


@pytest.mark.some(42)
@pytest.mark.parametrize(("case", "name"), TEXTS)
def test_numbers_of_ten_thousand_digits_are_read_or_refused_in_a_short_line(case, name, tmp_path):
    put(tmp_path, case.files)
    content = case.files[name]
    for n, number in enumerate(list(IS_NUMBER.finditer(content[:2000]))[:24]):
        huge = HUGE[n % len(HUGE)]
        (tmp_path / name).write_bytes(content[: number.start()] + huge + content[number.end() :])
        try:
            READERS[case.reader](tmp_path / next(iter(case.files)))
        except (ValueError, OSError) as error:
            line = one_line(error)
            assert "4300" not in line
            assert len(line) < 600


@pytest.mark.parametrize(("parse", "text"), [(json_of, "[{}]"), (toml_of, "a = {}")])
def test_parsers_say_that_a_number_is_too_large_not_what_python_has_a_limit_for(parse, text):
    with pytest.raises(ValueError, match="thousands of digits, beyond 64 bits; write it as 1e30"):
        parse(text.format("1" * 5000))


def test_python_s_limit_of_digits_is_told_in_words():
    with pytest.raises(ValueError, match=r"^a\.txt: a whole number has thousands"), naming("a.txt"):
        int("1" * 5000)


def test_long_words_and_messages_are_cut_short():
    assert one_line(ValueError(f"size {'1' * 5000}x3")) == "size 1111111111...x3"
    assert len(one_line(ValueError("ab " * 5000))) <= LONGEST + 5
    with pytest.raises(ValueError, match=r"^move .{60}; give 3 numbers"):
        numbers_in("move", "a" * 5000, 3)
