"""Tests of how the compiler writes for a processor."""

import os
import subprocess
import sys
from pathlib import Path

import numba
import pytest
from numba.core import codegen

from flexslew_plant.machine_code import processor

_MEMBERS = """
import numpy as np
from flexslew_plant.arrays import vectorised
from flexslew_plant.testbeds.compiled.sine_cosine import sine_cosine

@vectorised
def loop(w):
    for k in range(64):
        sine, cosine = sine_cosine(w[k])
        w[64 + k] = 3.1 * sine + 0.7 / (2.0 - cosine * w[k])

w = np.concatenate((np.linspace(-9.0, 9.0, 64), np.zeros(64)))
loop(w)
print(w.tobytes().hex())
"""


@pytest.mark.slow
def test_members_have_the_same_bits_by_vectors_of_every_width(tmp_path: Path) -> None:
    (tmp_path / "members.py").write_text(_MEMBERS)
    own: dict[str, str] = {}
    narrow = {"NUMBA_CPU_NAME": "haswell", "NUMBA_CPU_FEATURES": "+avx2,+fma"}
    found = {
        subprocess.run(
            [sys.executable, "-P", str(tmp_path / "members.py")],
            env=os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / str(k))} | given,
            check=True,
            capture_output=True,
            text=True,
        ).stdout
        for k, given in enumerate((own, narrow) if _has_fma() else (own,))
    }
    assert len(found) == 1


def _has_fma() -> bool:
    return "+fma" in codegen.get_host_cpu_features().split(",")


@pytest.mark.parametrize("features", ["+sse4.2,+avx2", "+avx2,+avx512f"])
@pytest.mark.parametrize("own", [None, "+avx2"])
def test_whole_vectors_are_taken_where_there_are_some_unless_the_user_says_so(
    monkeypatch: pytest.MonkeyPatch, features: str, own: str | None
) -> None:
    said = list[str]()
    monkeypatch.setattr(processor, "set_option", lambda _, option: said.append(option))
    monkeypatch.setattr(codegen, "get_host_cpu_features", lambda: features)
    monkeypatch.setattr(numba.config, "CPU_NAME", None)
    monkeypatch.setattr(numba.config, "CPU_FEATURES", own)
    processor.configure_compiler()
    whole = "avx512f" in features and own is None
    assert (f"{features},-prefer-256-bit" if whole else own) == numba.config.CPU_FEATURES
    assert ("--force-vector-interleave=2" in said) is whole
