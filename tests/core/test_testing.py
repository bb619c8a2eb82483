from dataclasses import dataclass

import numpy as np
import pytest

from resample import registry
from resample.profiles.orders import EverySample, Summing
from resample.profiles.reconstruction import GaussianKernel, ripple
from resample.testing import check_filter, check_order, check_reconstruction
from resample.types import Sheets


@pytest.mark.parametrize("name", registry.names("filters"))
def test_every_installed_filter_passes(name):
    check_filter(registry.build("filters", name))


@pytest.mark.parametrize("name", registry.names("reconstructions"))
def test_every_installed_reconstruction_passes_with_little_ripple(name):
    low, high = check_reconstruction(registry.build("reconstructions", name))
    assert -0.01 < low < 0 < high < 0.01


@pytest.mark.parametrize("name", registry.names("orders"))
def test_every_installed_order_passes(name):
    check_order(registry.build("orders", name))


def tent(distance):
    return np.maximum(2.0 - distance, 0.0)


@dataclass
class Kernel:
    """A plugin of a function: filter and reconstruction alike."""

    function: object = tent
    radius: object = 2.0

    def __call__(self, distance):
        return self.function(distance)


def overwriting(distance):
    distance *= 0.5
    return tent(2 * distance)


class Counting:
    """Gives something else at every call."""

    calls = 0

    def __call__(self, distance):
        self.calls += 1
        return tent(distance) * self.calls


WRONG_FORM = [
    (Kernel(radius=None), "has the radius None; it must be a positive, finite number of"),
    (Kernel(radius=0.0), "has the radius 0.0"),
    (Kernel(radius=np.inf), "has the radius inf"),
    (Kernel(radius=True), "has the radius True"),
    (Kernel(radius="2"), "has the radius '2'"),
    (Kernel(lambda d: float(tent(d).sum())), r"gives the shape \(\) for distances of the shape"),
    (Kernel(lambda d: tent(d).astype(int)), "of type int64; they must be floating-point"),
    (Kernel(lambda d: tent(d) / (d - d[:1])), "are not finite"),
    (Kernel(lambda d: tent(d) - d.flat[0]), "gives a distance different"),
    (Kernel(Counting()), "gives a distance different"),
    (Kernel(lambda d: -tent(d)), "must add up to more than 0"),
    (Kernel(overwriting), "overwrites the distances"),
    (object(), r"has no __call__\(distance\)"),
]


@pytest.mark.filterwarnings("ignore:invalid value:RuntimeWarning")
@pytest.mark.filterwarnings("ignore:divide by zero:RuntimeWarning")
@pytest.mark.parametrize("check", [check_filter, check_reconstruction])
@pytest.mark.parametrize(("plugin", "complaint"), WRONG_FORM)
def test_a_wrong_form_is_told(check, plugin, complaint):
    with pytest.raises(AssertionError, match=complaint):
        check(plugin)


def test_a_reconstruction_ends_at_its_radius():
    with pytest.raises(AssertionError, match="is 1 beyond its radius of 1 voxels; it must be 0"):
        check_reconstruction(Kernel(radius=1.0))


def test_a_reconstruction_reports_its_ripple():
    assert check_reconstruction(GaussianKernel()) == ripple(GaussianKernel())


def test_a_reconstruction_with_much_ripple_is_refused():
    with pytest.raises(
        AssertionError, match=r"a ripple of -\d+\.\d to \+\d+\.\d %; less than 10 %"
    ):
        check_reconstruction(GaussianKernel(sigma=0.3))


def test_a_reconstruction_may_be_negative_somewhere():
    def sharp(distance):
        return np.where(distance < 2, np.exp(-(distance**2)) * (1 - 0.3 * distance**2), 0.0)

    assert sharp(np.array([1.9])) < 0
    check_reconstruction(Kernel(sharp))


@dataclass
class Order:
    """A plugin of two functions."""

    key: object = lambda footprints: footprints["depth"].copy()
    sheet: object = lambda footprints: np.zeros(footprints.size, np.int32)
    thickness: object = 1.0
    summing: object = Summing.POINTS

    def __call__(self, seen):
        return Sheets(self.key(seen.footprints), self.sheet(seen.footprints))


def zeroed(footprints):
    footprints["depth"] = 0
    return footprints["depth"].copy()


@pytest.mark.parametrize(
    ("order", "complaint"),
    [
        (object(), r"has no __call__\(seen\)"),
        (Order(thickness=0), "has the thickness 0; it must be a positive, finite number of voxels"),
        (Order(summing=7), "has the summing 7; give one of"),
        (Order(key=lambda f: f["depth"].astype(float)), "gives key as float64"),
        (Order(key=lambda f: f["depth"][1:]), "it must be float32"),
        (Order(key=lambda f: f["depth"] * np.float32("inf")), "keys that are not finite"),
        (Order(sheet=lambda f: np.zeros(f.size, np.int64)), "gives sheet as int64"),
        (Order(sheet=lambda f: np.zeros((f.size, 1), np.int32)), "it must be int32"),
        (Order(sheet=lambda f: np.arange(f.size, dtype=np.int32)), "depends on the order"),
        (Order(key=zeroed), "overwrites the footprints"),
    ],
)
@pytest.mark.filterwarnings("ignore:invalid value:RuntimeWarning")
def test_a_wrong_order_is_told(order, complaint):
    with pytest.raises(AssertionError, match=complaint):
        check_order(order)


def test_an_order_gives_sheets():
    class Tuples(EverySample):
        def __call__(self, seen):
            return tuple(super().__call__(seen))

    with pytest.raises(AssertionError, match="gives tuple, not Sheets"):
        check_order(Tuples())


def test_an_order_must_take_no_footprints():
    class Greedy(EverySample):
        def __call__(self, seen):
            seen.footprints["depth"].min()
            return super().__call__(seen)

    with pytest.raises(ValueError, match="zero-size array"):
        check_order(Greedy())
