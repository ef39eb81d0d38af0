"""Networks that others have trained: known by name and SHA-256, fetched once, used offline afterwards."""

from dynhair.assets.cache import asset_path, fetch, is_fetched
from dynhair.assets.verbs import fetch_assets, list_assets, print_path

__all__ = ["asset_path", "fetch", "fetch_assets", "is_fetched", "list_assets", "print_path"]
