"""`python -m tests.metadata`: write the table of `docs/metadata.md` anew."""

from tests.metadata.pages import PAGE, filled

if __name__ == "__main__":
    PAGE.write_text(filled(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
