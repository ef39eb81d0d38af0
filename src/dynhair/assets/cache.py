"""The cache of assets on this computer: every file in it is verified before it is handed out.

The SHA-256 is checked at every use. That takes 50 ms for the largest file, less than loading the network it holds.
"""

from __future__ import annotations

import os
import re
import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from dynhair.assets.catalogue import Asset, find_asset
from dynhair.assets.download import SourceError, file_sha256, verify
from dynhair.assets.sources import Source
from dynhair.errors import DynhairError
from dynhair.storage import atomic_file


def asset_path(name: str) -> Path:
    """The file of an asset, downloaded if it is not in the cache or damaged there.

    Args:
        name: of the asset; ``dynhair assets list`` shows them.

    Raises:
        DynhairError: no asset has this name, or no source could give the file.
    """
    asset = find_asset(name)
    path = _cached(asset)
    if not _intact(path, asset):
        _download(asset, path)
    return path


def fetch(name: str, file: Path | None = None) -> Path:
    """Put an asset into the cache.

    Args:
        name: of the asset.
        file: the asset as a file on this computer; by default it is downloaded, unless the cache has it.

    Returns:
        Its path in the cache.

    Raises:
        DynhairError: no asset has this name, the file is another one, or no source could give it.
    """
    if file is None:
        return asset_path(name)
    asset = find_asset(name)
    try:
        found = file_sha256(file)
    except OSError as error:
        raise DynhairError(f"not readable ({error.strerror})", path=file) from error
    if found != asset.sha256:
        raise DynhairError(
            f"this is not {name}: it has SHA-256 {found} and {file.stat().st_size} bytes",
            path=file,
            expected=f"SHA-256 {asset.sha256}, {asset.size} bytes",
        )
    path = _cached(asset)
    with _cache_errors(), atomic_file(path) as temporary:
        shutil.copyfile(file, temporary)
    return path


def is_fetched(name: str) -> bool:
    """Whether the cache has the asset, undamaged.

    Raises:
        DynhairError: no asset has this name.
    """
    asset = find_asset(name)
    return _intact(_cached(asset), asset)


def cache_folder() -> Path:
    """The folder of the cache: ``$DYNHAIR_CACHE``, or else the operating system's usual place."""
    from pooch import os_cache

    chosen = os.environ.get("DYNHAIR_CACHE")
    return Path(chosen).expanduser() if chosen else Path(os_cache("dynhair"))


def _cached(asset: Asset) -> Path:
    return cache_folder() / asset.filename


def _intact(path: Path, asset: Asset) -> bool:
    return path.is_file() and path.stat().st_size == asset.size and file_sha256(path) == asset.sha256


def _download(asset: Asset, path: Path) -> None:
    damaged = path.exists()
    failures: list[str] = []
    for source in asset.sources:
        try:
            with _cache_errors():
                _download_from(source, asset, path)
        except SourceError as error:
            failures.append(f"  {source.address}: {error}")
        else:
            print(f"fetched {asset.name}; licence: {asset.licence}", file=sys.stderr)
            return
    reasons = re.sub(r"//[^/@\s]+@", "//***@", "\n".join(failures))  # an index's address may have a password in it
    raise DynhairError(
        f"{asset.name} {'is damaged' if damaged else 'is missing'} and no source could give it:\n{reasons}",
        path=path,
        expected=f"a file with SHA-256 {asset.sha256}, {asset.size} bytes",
        mend=f"try again with a connection; or run `dynhair assets path {asset.name}` on a computer that has one, "
        f"bring the file it prints here and run `dynhair assets fetch {asset.name} --file FILE`",
    )


def _download_from(source: Source, asset: Asset, path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    # the scratch is in the cache because the system's temporary folder may be too small for an archive
    with TemporaryDirectory(prefix=".download-", dir=path.parent) as scratch, atomic_file(path) as temporary:
        temporary.write_bytes(source.read(Path(scratch)))
        verify(temporary, asset.sha256)


@contextmanager
def _cache_errors() -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise DynhairError(
            f"the cache cannot be written ({error})",
            path=cache_folder(),
            mend="make room there, or set DYNHAIR_CACHE to a folder that you may write to",
        ) from error
