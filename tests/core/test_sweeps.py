"""What `make test` leaves out is kept by a test that it runs."""

from tests.conftest import COLLECTED


def test_each_sweep_names_a_test_of_make_test_that_keeps_its_claim(request):
    collected = request.config.stash[COLLECTED]
    run = {name.partition("[")[0] for name, sweep in collected if sweep is None}
    files = {name.partition("::")[0] for name, _ in collected}
    for name, sweep in collected:
        if sweep is None:
            continue
        assert set(sweep) == {"kept_by"}, f"{name}: say sweep(kept_by='the test that keeps it')"
        file, _, test = sweep["kept_by"].rpartition("::")
        kept_by = f"{file or name.partition('::')[0]}::{test}"
        if kept_by.partition("::")[0] in files:  # or only a part of the tests is run
            assert kept_by in run, f"{name}: no test {kept_by} is run by `make test`"
