"""Puts libslide.so into the package: the file that SLIDE_LIBRARY names, else one that CMake builds."""

import os
import pathlib
import re
import shutil
import subprocess

from setuptools import Distribution, setup
from setuptools.command.build_py import build_py
from wheel.bdist_wheel import bdist_wheel

HERE = pathlib.Path(__file__).resolve().parent
SOURCE = HERE.parent.parent


def version():
    text = (SOURCE / "CMakeLists.txt").read_text()
    return re.search(r"project\(slide VERSION ([0-9.]+)", text).group(1)


def build_library(folder):
    """Builds the shared library in `folder` and returns its path."""
    subprocess.check_call([
        "cmake", "-S", SOURCE, "-B", folder, "-DCMAKE_BUILD_TYPE=Release", "-DSLIDE_SHARED=ON",
        "-DSLIDE_OPENIMAGEIO=OFF", "-DSLIDE_TESTS=OFF"])
    subprocess.check_call(["cmake", "--build", folder, "--parallel", "--target", "slide_shared"])
    return pathlib.Path(folder) / "lib" / "libslide.so"


class BuildWithLibrary(build_py):
    def run(self):
        super().run()
        library = os.environ.get("SLIDE_LIBRARY") or build_library(HERE / "build" / "cmake")
        shutil.copyfile(library, pathlib.Path(self.build_lib) / "slide" / "libslide.so")


class AnyPython(bdist_wheel):
    """For one kind of machine, and every Python: the library does not know what calls it."""

    def get_tag(self):
        return "py3", "none", super().get_tag()[2]


class WithLibrary(Distribution):
    def has_ext_modules(self):
        return True


setup(version=version(), distclass=WithLibrary,
      cmdclass={"build_py": BuildWithLibrary, "bdist_wheel": AnyPython})
