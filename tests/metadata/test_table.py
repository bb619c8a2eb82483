"""The table of the documentation is that of the corpus."""

from tests.metadata.pages import PAGE, filled, variants


def test_the_page_lists_every_variant() -> None:
    """`python -m tests.metadata` writes the table anew."""
    page = PAGE.read_text(encoding="utf-8")
    assert filled(page) == page


def test_every_variant_has_a_name_of_its_own() -> None:
    """A name says format, field and case."""
    names = [str(one) for one in variants()]
    assert len(set(names)) == len(names)


def test_what_is_not_obeyed_has_a_message() -> None:
    """A pattern of what is said to the user."""
    assert all((one.outcome == "obeyed") == (not one.says) for one in variants())
