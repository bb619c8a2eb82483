from dataclasses import dataclass
from itertools import count

import numpy as np
import pytest

from resample import registry
from resample.profiles.orders import Summing
from resample.profiles.reconstruction import GaussianKernel, ripple
from resample.testing import check_filter, check_order, check_reconstruction
from resample.types import Layers

ALONG = Layers((0.0, 0.6, 0.8), 1.5, 0.7)
COUNT = count(1.0)


@pytest.mark.parametrize("name", registry.names("filters"))
def test_every_installed_filter_passes(name):
    check_filter(registry.build("filters", name))


@pytest.mark.sweep
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


@pytest.mark.sweep
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
    """A plugin of some numbers, or of what gives them."""

    given: object = ALONG
    thickness: object = 1.0
    summing: object = Summing.POINTS

    def __call__(self, view, lattice):
        return self.given(view, lattice) if callable(self.given) else self.given


def overwriting(_, lattice):
    lattice *= 2.0
    return ALONG


def turning(view, _):
    view.rotation[0] = 0.0
    return ALONG


@pytest.mark.parametrize(
    ("order", "complaint"),
    [
        (object(), r"has no __call__\(view, lattice\)"),
        (Order(thickness=0), "has the thickness 0; it must be a positive, finite number of voxels"),
        (Order(summing=7), "has the summing 7; give one of"),
        (Order(tuple(ALONG)), "gives tuple, not Layers"),
        (Order(ALONG._replace(axis=(0.0, 1.0))), r"the axis \(0.0, 1.0\); it is \(x, y, z\)"),
        (Order(ALONG._replace(offset=np.zeros(9))), "must be floating-point numbers"),
        (Order(ALONG._replace(offset=np.inf)), "which is not finite"),
        (Order(ALONG._replace(eye=np.inf)), "the eye's place inf"),
        (Order(ALONG._replace(thickness=0.0)), "layers of the thickness 0.0"),
        (Order(ALONG._replace(axis=(0.0, 0.0, 0.0))), "an axis of zero length"),
        (Order(ALONG, summing=Summing.SLABS), "sums slabs, which needs layers of even depth"),
        (Order(lambda *_: ALONG._replace(offset=next(COUNT))), "other layers when it is called"),
        (Order(overwriting), "overwrites the lattice"),
        (Order(turning), "overwrites the view"),
    ],
)
def test_a_wrong_order_is_told(order, complaint):
    with pytest.raises(AssertionError, match=complaint):
        check_order(order)


@pytest.mark.parametrize("summing", [Summing.POINTS, Summing.SHEETS])
def test_an_order_along_any_axis_will_do(summing):
    check_order(Order(ALONG, summing=summing))
    check_order(Order(ALONG._replace(eye=3.0, begins_at_first=True), summing=summing))
    check_order(Order(ALONG._replace(axis=(0.0, 0.0, 0.0), is_around=True), summing=summing))
