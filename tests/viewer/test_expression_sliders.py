"""What the sliders of the face are called."""

from __future__ import annotations

from dynhair.capture import ExpressionBasis
from dynhair.viewer.expression_sliders import expression_sliders
from tiny_avatars import make_avatar


def test_only_what_has_no_name_is_numbered() -> None:
    avatar = make_avatar(basis=ExpressionBasis("someone", ("jaw", "", "blink", "")))
    labels = {slider.index: slider.label for slider in expression_sliders(avatar, [])}
    assert labels == {0: "jaw", 1: "coefficient 1", 2: "blink", 3: "coefficient 3"}
