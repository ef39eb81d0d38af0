"""What ``dynhair assets list``, ``fetch`` and ``path`` do."""

from __future__ import annotations

from pathlib import Path

from dynhair.assets.cache import asset_path, cache_folder, fetch, is_fetched
from dynhair.assets.catalogue import CATALOGUE, find_asset
from dynhair.errors import DynhairError


def list_assets() -> None:
    """Print a table of the assets: name, use, size, licence, and whether the cache has them."""
    from rich.console import Console
    from rich.filesize import decimal
    from rich.table import Table

    table = Table("name", "for", "size", "licence", "fetched", caption=f"cache: {cache_folder()}")
    table.columns[0].no_wrap = table.columns[2].no_wrap = True
    for asset in CATALOGUE:
        fetched = "yes" if is_fetched(asset.name) else "no"
        table.add_row(asset.name, asset.purpose, decimal(asset.size), asset.licence, fetched)
    Console().print(table)


def fetch_assets(names: tuple[str, ...] = (), file: Path | None = None) -> None:
    """Fetch assets into the cache and print where they are.

    Args:
        names: of the assets; all by default.
        file: a file on this computer to take the one named asset from, instead of downloading it.

    Raises:
        DynhairError: a name is unknown, a file is given for other than one name, or the asset cannot be had.
    """
    if file is not None and len(names) != 1:
        raise DynhairError(f"a file was given for {len(names)} assets", expected="one name with --file")
    for asset in [find_asset(name) for name in names] or CATALOGUE:
        print(f"{asset.name}: {fetch(asset.name, file)}")


def print_path(name: str) -> None:
    """Print the path of an asset's file, fetching it first if it is missing.

    Raises:
        DynhairError: no asset has this name, or it cannot be had.
    """
    print(asset_path(name))
