"""Packages that are installed on request, and how to install one that is missing."""

import importlib
from pathlib import Path
from types import ModuleType

# the extra by package; `control` and its matplotlib come with the bench itself by pip
EXTRAS = {
    "casadi": "casadi",
    "control": "control",
    "ctrlsys": "ctrlsys",
    "distributed": "dask",
    "fmpy": "fmu",
    "foxglove": "foxglove",
    "gymnasium": "gym",
    "h5py": "measurements",
    "matplotlib": "control",
    "nicegui": "console",
    "onnxruntime": "onnx",
    "optuna": "gains",
    "pandas": "pandas",
    "pyarrow": "export",
    "pyuff": "measurements",
    "pyyeti": "nastran",
    "serial": "serial",
    "websockets": "foxglove",
    "xarray": "xarray",
    "ziglang": "c",
}
WITH_PIP = "control"  # what `pip install .` brings without an extra
LOCK = "requirements.extra.{}.lock.txt"  # in setup/, for `./flexslew extras NAME`


def install_command(package: str) -> str:
    """Return the command that installs a package of EXTRAS: of a checkout, or of pip."""
    extra = EXTRAS[package]
    for folder in Path(__file__).resolve().parents:
        if (folder / "setup" / LOCK.format(extra)).is_file():
            return f"./flexslew extras {extra}"
    return f"pip install {package}" if extra == WITH_PIP else f"pip install 'flexslew[{extra}]'"


def required(package: str) -> ModuleType:
    """Return a package of EXTRAS, imported.

    Raises:
        ModuleNotFoundError: if it is not installed; the message names the command that installs it.
    """
    try:
        return importlib.import_module(package)
    except ModuleNotFoundError as error:
        if error.name != package:
            raise
        words = f"{package} is not installed: {install_command(package)}"
        raise ModuleNotFoundError(words, name=package) from None
