"""The example of a board, linked for a bare Cortex-M7."""

from pathlib import Path

import pytest

from flexslew_lab.export.targets import compiled_for

BOARD = Path(__file__).parents[3] / "docs/examples/board"
PAGE = (BOARD.parents[1] / "rig.md").read_text()


def test_the_board_is_a_program_for_a_bare_cortex_m7_of_the_stated_size(tmp_path: Path) -> None:
    pytest.importorskip("ziglang", reason="ziglang is not installed: ./flexslew extras c")
    frames: dict[str, int] = {}
    objects = []
    for name in ("line", "board", "uart_cortex_m7"):
        objects.append(tmp_path / f"{name}.o")
        frames |= compiled_for("Cortex-M7", [BOARD / f"{name}.c"], objects[-1]).frames
    link = ("-Qunused-arguments", "-Wl,-e,board_run", "-Wl,--gc-sections")
    program = tmp_path / "board.elf"
    found = compiled_for("Cortex-M7", objects, program, link)
    head = program.read_bytes()[:20]
    assert (head[:4], head[4], head[18]) == (b"\x7fELF", 1, 40)  # 32 bits, ARM
    assert "board_run" in frames
    stack = sum(frames.values())  # at most: no function calls itself
    for number, most in ((found.fixed, 4096), (found.writable, 4096), (stack, 512)):
        assert 0 < number <= most
    words = "less than 4 KiB of code, 4 KiB of RAM and 512 bytes of stack"
    assert words in " ".join(PAGE.split())
