"""Packages that come when asked for, and how to get one that is missing."""

import importlib
from pathlib import Path
from types import ModuleType

# the extra of `pip install` by package; empty: comes with the bench there, not with a checkout
EXTRAS = {
    "casadi": "casadi",
    "control": "",
    "ctrlsys": "ctrlsys",
    "distributed": "dask",
    "foxglove": "foxglove",
    "matplotlib": "",
    "nicegui": "console",
    "optuna": "gains",
    "pandas": "pandas",
    "pyarrow": "export",
    "websockets": "foxglove",
    "xarray": "xarray",
}
_LOCK = "setup/requirements.extra.lock.txt"  # what `./flexslew extras` installs


def how_to_install(package: str) -> str:
    """Return the command that installs a package of EXTRAS: of a checkout, or of pip."""
    for folder in Path(__file__).resolve().parents:
        lock = folder / _LOCK
        if lock.is_file() and f"\n{package}" in lock.read_text():
            return "./flexslew extras"
    extra = EXTRAS[package]
    return f"pip install 'flexslew[{extra}]'" if extra else f"pip install {package}"


def required(package: str) -> ModuleType:
    """Return a package of EXTRAS, imported.

    Raises:
        ModuleNotFoundError: it is not installed; says what installs it.
    """
    try:
        return importlib.import_module(package)
    except ModuleNotFoundError as error:
        if error.name != package:
            raise
        words = f"{package} is not installed: {how_to_install(package)}"
        raise ModuleNotFoundError(words, name=package) from None
