"""The one thing that pyproject.toml cannot say: wheels carry the bundled capture, which lies outside the package."""

import shutil
from pathlib import Path

from setuptools import setup
from setuptools.command.build_py import build_py


class BuildWithSample(build_py):
    """Copy data/sample_capture into the package of a wheel; an editable install reads it from the checkout."""

    def run(self) -> None:
        super().run()
        if not self.editable_mode:
            sample = Path(self.build_lib) / "dynhair" / "sample_capture"
            shutil.copytree(Path(__file__).parent / "data" / "sample_capture", sample, dirs_exist_ok=True)


setup(cmdclass={"build_py": BuildWithSample})
