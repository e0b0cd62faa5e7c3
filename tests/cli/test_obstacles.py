"""`--obstacle x,y,r[,low]`."""

from __future__ import annotations

import pytest

from navstack.cli.arguments import parse_obstacles
from navstack.core import InputError
from navstack.sim import LOW


def test_normal_and_low_obstacles() -> None:
    obstacles, shapes = parse_obstacles(["3.0,1.5,0.2", "4, 2, 0.1, low", "5,5,0.3"])
    assert obstacles == ((3.0, 1.5, 0.2), (5.0, 5.0, 0.3))
    ((shape,),) = (shapes,)
    assert (shape.pose, shape.radius, shape.height) == ([4.0, 2.0, 0.0], 0.1, LOW)
    assert parse_obstacles([]) == ((), ())


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1,2", "2 numbers"),
        ("1,2,low", "2 numbers"),
        ("1,2,0.1,high", '"high" is not a number'),
        ("1,2,-0.1,low", "radius must be positive"),
        ("low", "not a number"),
    ],
)
def test_invalid_obstacles(text: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        parse_obstacles([text])
