"""Reading the images of a view, in parallel and within a budget of memory."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from dynhair.capture.cache import ByteCache
from dynhair.capture.encoding import EncodedView, read_mask, read_orientation, read_rgb
from dynhair.capture.layout import Layout
from dynhair.capture.records import View
from dynhair.errors import DynhairError
from dynhair.threads import thread_count


@dataclass(frozen=True)
class ViewFiles:
    """One view: its name and the folder of its images."""

    folder: Path
    name: str


class ViewReader:
    """Reads views and keeps those used last.

    Args:
        layout: where the files are.
        image_size: width and height that every image must have.
        on_black: put images on black by their mask, as they show a background of their own.
        cache_bytes: memory for decoded images.
    """

    def __init__(self, layout: Layout, image_size: tuple[int, int], *, on_black: bool, cache_bytes: int) -> None:
        self.layout = layout
        self.image_size = image_size
        self.on_black = on_black
        self.cache: ByteCache[ViewFiles, EncodedView] = ByteCache(cache_bytes)

    def read(self, views: Sequence[ViewFiles]) -> list[View]:
        """Read views, decoding in parallel those that are not in memory.

        Raises:
            DynhairError: one of them cannot be read.
        """
        found = self.attempt(views)
        for view in found:
            if isinstance(view, DynhairError):
                raise view
        return [view for view in found if isinstance(view, View)]

    def attempt(self, views: Sequence[ViewFiles]) -> list[View | DynhairError]:
        """Read views as `read` does; what cannot be read is given as the error that says why."""
        found: dict[ViewFiles, EncodedView | DynhairError | None] = {view: self.cache.get(view) for view in views}
        missing = [view for view, encoded in found.items() if encoded is None]
        workers = min(len(missing), thread_count())
        if workers > 1:
            with ThreadPoolExecutor(workers) as pool:
                found.update(zip(missing, pool.map(self._attempt, missing), strict=True))
        elif missing:
            found.update((view, self._attempt(view)) for view in missing)
        loaded = [found[view] for view in views]
        return [item.decoded() if isinstance(item, EncodedView) else item for item in loaded if item is not None]

    def _attempt(self, view: ViewFiles) -> EncodedView | DynhairError:
        try:
            return self._load(view)
        except DynhairError as error:
            return error

    def _load(self, view: ViewFiles) -> EncodedView:
        mask = self._read_map(view, "mask", read_mask)
        rgb = self._read_map(view, "image", read_rgb)
        encoded = EncodedView(
            rgb=_on_black(rgb, mask) if self.on_black else rgb,
            mask=mask,
            hair=self._read_map(view, "hair", read_mask) if self._has_hair else None,
            orientation=self._read_map(view, "orient", read_orientation) if self._has_orientation else None,
        )
        self.cache.put(view, encoded)
        return encoded

    def _read_map(self, view: ViewFiles, kind: str, read: Callable[[Path], np.ndarray]) -> np.ndarray:
        path = self.layout.find_image(view.folder, kind, view.name)
        if path is None:
            lowres = "lowres_" if self.layout.lowres else ""
            raise DynhairError(
                "the file is missing",
                path=view.folder / f"{kind}_{lowres}{view.name}.png",
                expected="a .png or .jpg",
                mend="write it, or leave its frame out of the segments",
            )
        pixels = read(path)
        size = (pixels.shape[1], pixels.shape[0])
        if size != self.image_size:
            raise DynhairError(
                f"is {size[0]} x {size[1]} pixels",
                path=path,
                expected=f"{self.image_size[0]} x {self.image_size[1]}",
                mend="write all images of the capture in the one size that capture.json says",
            )
        return pixels

    # a map that no view has is absent; one that only some views have is missing from the others

    @cached_property
    def _has_hair(self) -> bool:
        return self.layout.has_any("hair")

    @cached_property
    def _has_orientation(self) -> bool:
        return self.layout.has_any("orient")


def _on_black(rgb: np.ndarray, mask: np.ndarray) -> np.ndarray:
    return ((rgb.astype(np.uint16) * mask[..., None] + 127) // 255).astype(np.uint8)
