from __future__ import annotations

import pytest

from debrisgrasp.geometry import SE3, Box, Capsule, Cylinder, SolidContent, Sphere

AT = SE3.from_parts(p=[0.1, 0.0, 0.0])


@pytest.mark.parametrize(
    "make",
    [
        lambda at: Box([0.1, 0.2, 0.3], at),
        lambda at: Sphere(0.1, at.p),
        lambda at: Cylinder(0.1, 0.2, at),
        lambda at: Capsule(0.1, 0.2, at),
    ],
)
def test_solids_are_told_apart_by_what_they_are_and_where(make):
    one = SolidContent.of([make(AT)])
    assert one == SolidContent.of([make(SE3.from_parts(p=[0.1, 0.0, 0.0]))])
    assert hash(one) == hash(SolidContent.of([make(AT)]))
    assert one != SolidContent.of([make(SE3.identity())])


def test_kind_size_and_order_make_a_difference():
    bar, rod = Cylinder(0.1, 0.2, AT), Capsule(0.1, 0.2, AT)
    assert SolidContent.of([bar]) != SolidContent.of([rod])
    assert SolidContent.of([bar]) != SolidContent.of([Cylinder(0.1, 0.3, AT)])
    assert SolidContent.of([bar, rod]) != SolidContent.of([rod, bar])
