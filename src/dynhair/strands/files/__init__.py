"""Files of strands: ``.hair``, ``.data``, ``.ply`` and ``.npz``, read and written; Alembic and USD, read."""

from dynhair.strands.files.formats import read_strands, write_strands
from dynhair.strands.files.strand_file import StrandFile

__all__ = ["StrandFile", "read_strands", "write_strands"]
