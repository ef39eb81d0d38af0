"""How a person was recorded: what a new motion of the avatar begins from, and where it is looked at from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from jaxtyping import Float64

from dynhair.avatar.head_pose import HeadPose
from dynhair.camera import Camera
from dynhair.motion import so3_log


@dataclass(frozen=True)
class Recording:
    """What an avatar keeps of the capture that it was trained on.

    Attributes:
        fps: frames per second; the hair's network was trained on motion at this rate.
        gravity: in the world, m/s^2.
        rest: pose and expression of the frame in which the hair is at rest; float32, on the CPU.
        camera: the one that the face looks at most in that frame.
    """

    fps: float
    gravity: Float64[np.ndarray, " 3"]
    rest: HeadPose
    camera: Camera

    def to_json(self) -> dict[str, Any]:
        """Return the JSON object that :meth:`from_json` reads back."""
        rest, camera = self.rest, self.camera
        return {
            "fps": self.fps,
            "gravity": self.gravity.tolist(),
            "rest": {
                "rotation": rest.rotation.tolist(),
                "translation": rest.translation.tolist(),
                "expression": rest.expression.tolist(),
            },
            "camera": {
                "w2c": camera.w2c.tolist(),
                "K": camera.K.tolist(),
                "width": camera.width,
                "height": camera.height,
            },
        }

    @classmethod
    def from_json(cls, description: Mapping[str, Any]) -> Recording:
        """Read what :meth:`to_json` returned.

        Raises:
            KeyError: something is missing.
            TypeError: something is of another kind.
            ValueError: something has another shape, or is not finite.
        """
        rest, camera = description["rest"], description["camera"]
        rotation = _numbers(rest["rotation"], 3, 3)
        return cls(
            fps=float(_numbers(description["fps"])),
            gravity=_numbers(description["gravity"], 3),
            rest=HeadPose(
                rotation=torch.from_numpy(rotation).float(),
                translation=torch.from_numpy(_numbers(rest["translation"], 3)).float(),
                rotation_vector=so3_log(torch.from_numpy(rotation)).float(),
                expression=torch.from_numpy(_numbers(rest["expression"], len(rest["expression"]))).float(),
            ),
            camera=Camera(
                w2c=torch.from_numpy(_numbers(camera["w2c"], 3, 4)).float(),
                K=torch.from_numpy(_numbers(camera["K"], 3, 3)).float(),
                width=int(camera["width"]),
                height=int(camera["height"]),
            ),
        )


def recording_in(description: Mapping[str, Any]) -> Recording | None:
    """The recording that an avatar's description holds; None where an older one holds none.

    Raises:
        KeyError, TypeError, ValueError: it is damaged.
    """
    found = description.get("recording")
    return None if found is None else Recording.from_json(found)


def _numbers(value: Any, *shape: int) -> np.ndarray:
    """Finite numbers of the given shape."""
    numbers = np.array(value, np.float64)
    if numbers.shape != shape or not np.isfinite(numbers).all():
        raise ValueError(f"finite numbers of the shape {shape} were expected, not {value!r}")
    return numbers
